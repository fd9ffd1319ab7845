"""The service: the ledger of evaluations, the API over it, and the `hide` command."""

from server.kernels import settle_kernels

settle_kernels()  # before anything of the service loads NumPy
