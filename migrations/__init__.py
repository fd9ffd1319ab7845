"""The history of the database schema, one numbered change a file."""
