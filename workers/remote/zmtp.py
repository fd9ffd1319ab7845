"""The client's side of a ZeroMQ REQ socket, over a connection that was vetted.

libzmq connects anew by itself, and gathers the parts of a message without an end; this does
neither. It speaks ZMTP 3.0 without security, as GR00T's servers do.
Source: RFC 23/ZMTP 3.0 and 28/REQREP of rfc.zeromq.org.
"""

import socket
import struct

MORE, LONG, COMMAND = 1, 2, 4  # flags of a frame
SIGNATURE = b"\xff" + bytes(8) + b"\x7f"
GREETING = SIGNATURE + b"\x03\x00" + b"NULL".ljust(20, b"\0") + bytes(32)
LARGEST_COMMAND = 512  # bytes
READY = b"\x05READY" + b"\x0bSocket-Type" + struct.pack(">I", 3) + b"REQ"


class ZmtpError(ValueError):
    """The peer speaks something else, or too much of it."""


class Requests:
    """Requests and their replies, one after the other.

    Args:
        connection: to a REP socket; how long it may take is its own affair.
        largest: bytes of a reply.

    Raises:
        ZmtpError: the peer is none.
        OSError, EOFError: it is gone.
    """

    def __init__(self, connection: socket.socket, largest: int):
        self._socket, self._largest = connection, largest
        connection.sendall(GREETING)
        _require_null(self._read(len(GREETING)))
        connection.sendall(_frame(COMMAND, READY))
        flags, command = self._receive(LARGEST_COMMAND)
        if not flags & COMMAND or not command.startswith(b"\x05READY"):
            raise ZmtpError("it is not ready")
        if _socket_type(command) not in (b"REP", b"ROUTER"):
            raise ZmtpError("its socket answers no requests")

    def ask(self, request: bytes) -> bytes:
        """The reply to a request.

        Raises:
            ZmtpError: it is none, or too large.
            OSError, EOFError: the peer is gone.
        """
        self._socket.sendall(_frame(MORE, b"") + _frame(0, request))
        if self._receive(0) != (MORE, b""):
            raise ZmtpError("the reply has no delimiter")
        flags, reply = self._receive(self._largest)
        if flags:
            raise ZmtpError("the reply has more than one part")
        return reply

    def close(self) -> None:
        """Ends the connection."""
        self._socket.close()

    def _receive(self, largest: int) -> tuple[int, bytes]:
        """The flags MORE and COMMAND of the next frame, and what is in it."""
        flags = self._read(1)[0]
        if flags & ~(MORE | LONG | COMMAND):
            raise ZmtpError("a frame with unknown flags")
        size = struct.unpack(">Q", self._read(8))[0] if flags & LONG else self._read(1)[0]
        if size > largest:
            raise ZmtpError(f"a frame of {size} bytes; at most {largest} are read")
        return flags & ~LONG, self._read(size)

    def _read(self, size: int) -> bytes:
        data = bytearray()
        while len(data) < size:
            piece = self._socket.recv(min(size - len(data), 2**16))
            if not piece:
                raise EOFError("the connection was closed")
            data += piece
        return bytes(data)


def _require_null(greeting: bytes) -> None:
    if greeting[0] != 0xFF or greeting[9] != 0x7F:
        raise ZmtpError("it speaks no ZeroMQ")
    if greeting[10] < 3:
        raise ZmtpError(f"it speaks version {greeting[10]} of ZMTP; expected 3")
    if greeting[12:32].rstrip(b"\0") != b"NULL":
        raise ZmtpError("it wants another security mechanism than NULL")


def _frame(flags: int, data: bytes) -> bytes:
    if len(data) > 255:
        return struct.pack(">BQ", flags | LONG, len(data)) + data
    return struct.pack(">BB", flags, len(data)) + data


def _socket_type(command: bytes) -> bytes:
    """The property Socket-Type of a READY command; empty if it has none."""
    rest = command[6:]
    while rest:
        name_end = 1 + rest[0]
        head, sized = rest[1:name_end], rest[name_end : name_end + 4]
        if len(sized) < 4:
            raise ZmtpError("a command that breaks off")
        value_end = name_end + 4 + struct.unpack(">I", sized)[0]
        if head.lower() == b"socket-type":
            return rest[name_end + 4 : value_end]
        rest = rest[value_end:]
    return b""
