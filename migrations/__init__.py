"""Alembic's migrations of the ledger, numbered, one change each.

The server runs them when it starts (`server.db.migrate`). To write the next one: change
`server/models.py`, then `.venv/bin/python -m migrations "what changes"`.
"""
