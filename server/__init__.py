"""The service: the ledger of evaluations, the API over it, and the `hide` command."""
