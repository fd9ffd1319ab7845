"""Which system calls a closed process may not make; libseccomp makes a filter of it.

Calculating, reading and threads stay possible. No further process, no socket but the pair it is
given, no shared memory that nobody counts, no hand on other processes, no way to loosen any of it.
"""

import errno
import os

NEVER = """
fork vfork execve execveat unshare setns setsid setpgid
socket io_uring_setup io_uring_enter io_uring_register memfd_create memfd_secret
shmget shmat msgget semget mq_open
ptrace process_vm_readv process_vm_writev process_madvise process_mrelease kcmp tkill
pidfd_open pidfd_getfd pidfd_send_signal setpriority ioprio_set sched_setscheduler
sched_setparam sched_setattr migrate_pages move_pages
mount umount2 pivot_root chroot open_tree move_mount fsopen fsconfig fsmount fspick
mount_setattr name_to_handle_at open_by_handle_at mknod mknodat fanotify_init quotactl
quotactl_fd swapon swapoff
bpf perf_event_open userfaultfd add_key request_key keyctl kexec_load kexec_file_load
init_module finit_module delete_module reboot acct syslog lookup_dcookie iopl ioperm
modify_ldt personality settimeofday clock_settime clock_adjtime adjtimex sethostname
setdomainname vhangup
"""
METADATA = """
chmod fchmod fchmodat fchmodat2 chown lchown fchown fchownat utime utimes utimensat futimesat
setxattr lsetxattr fsetxattr removexattr lremovexattr fremovexattr truncate
"""  # Landlock does not look at these
TO_A_PROCESS = ("kill", "tgkill", "rt_sigqueueinfo", "rt_tgsigqueueinfo")  # the first argument

CLONE_THREAD = 0x10000  # clone(2)
SHARED_ANONYMOUS = 0x21  # mmap(2): MAP_SHARED | MAP_ANONYMOUS
PR_SET_PDEATHSIG, SIGKILL = 1, 9  # prctl(2)
OWNER_OF_A_FILE = (8, 10, 15)  # fcntl(2): F_SETOWN, F_SETSIG, F_SETOWN_EX send signals
OWNER_OF_A_SOCKET = (0x8901, 0x8902)  # ioctl(2): FIOSETOWN, SIOCSPGRP
TYPES_INTO_A_TERMINAL = (0x5412, 0x541C)  # ioctl(2): TIOCSTI, TIOCLINUX
WORD = 0xFFFFFFFF  # the kernel reads these arguments as 32 bits


def close(*, metadata: bool) -> None:
    """Installs the filter in this process.

    Args:
        metadata: also keep it from changing modes, owners and times of files.

    Raises:
        ImportError: libseccomp is not there.
        OSError: the kernel does not take it.
    """
    from pyseccomp import ALLOW, ERRNO, MASKED_EQ, NE, Arg, Attr, SyscallFilter

    denied = ERRNO(errno.EPERM)
    rules = SyscallFilter(ALLOW)
    rules.set_attr(Attr.CTL_TSYNC, 1)
    for name in (NEVER + METADATA * metadata).split():
        if known(name):
            rules.add_rule(denied, name)
    rules.add_rule(ERRNO(errno.ENOSYS), "clone3")  # its flags cannot be seen; clone's can
    rules.add_rule(denied, "clone", Arg(0, MASKED_EQ, CLONE_THREAD, 0))
    rules.add_rule(denied, "mmap", Arg(3, MASKED_EQ, SHARED_ANONYMOUS, SHARED_ANONYMOUS))
    for name in TO_A_PROCESS:
        rules.add_rule(denied, name, Arg(0, NE, os.getpid()))
    rules.add_rule(denied, "sched_setaffinity", Arg(0, NE, 0))
    rules.add_rule(denied, "prlimit64", Arg(0, NE, 0))
    rules.add_rule(denied, "prctl", Arg(0, MASKED_EQ, WORD, PR_SET_PDEATHSIG), Arg(1, NE, SIGKILL))
    for call, commands in (
        ("fcntl", OWNER_OF_A_FILE),
        ("ioctl", OWNER_OF_A_SOCKET + TYPES_INTO_A_TERMINAL),
    ):
        for command in commands:
            rules.add_rule(denied, call, Arg(1, MASKED_EQ, WORD, command))
    rules.load()


def known(name: str) -> bool:
    """True if this machine has such a system call."""
    from pyseccomp import resolve_syscall, system_arch

    return bool(resolve_syscall(system_arch(), name) >= 0)
