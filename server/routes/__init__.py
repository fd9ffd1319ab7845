"""The routes of the API, one resource a file. They translate; they do not decide."""
