"""What a policy's process may see and do: chosen by `choice`, shown by `view`, held to by the rest.

`bubblewrap` gives it namespaces of its own, `landlock` closes its files; in both `confinement`
limits memory, files and time and filters its system calls, before any of its code is read.
"""
