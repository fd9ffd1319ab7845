/** SHA-256 of a file of any size; the browser's own digest wants all of it in memory, and TLS. */
import { Refused } from "./api.js";
import { sha256 } from "../vendor/noble-hashes/sha2.js";

const PIECE = 2 ** 20; // bytes that are read at once: a few ms, so that the page stays alive

/**
 * SHA-256 in hexadecimal digits.
 * @param {File} file
 * @param {(done: number) => void} told is called with the bytes that are hashed; what it throws ends it
 * @returns {Promise<string>}
 * @throws {Refused} it cannot be read
 */
export async function digestOf(file, told) {
  const hash = sha256.create();
  for (let at = 0; at < file.size; at += PIECE) {
    told(at);
    hash.update(new Uint8Array(await read(file.slice(at, at + PIECE))));
  }
  told(file.size);
  return [...hash.digest()].map((byte) => byte.toString(16).padStart(2, "0")).join("");
}

/** Does nothing if the file is as it was chosen. @param {File} file @throws {Refused} */
export async function readable(file) {
  await read(file.slice(0, 1));
}

/** @param {Blob} part */
async function read(part) {
  try {
    return await part.arrayBuffer();
  } catch {
    const message = "cannot be read any more: it was moved or changed; choose it again";
    throw new Refused({ title: message, status: 0, errors: [{ field: "body", message }] });
  }
}
