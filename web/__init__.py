"""The pages of the site, rendered on the server and added to its API."""
