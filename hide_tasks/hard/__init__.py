"""Suite `hide-hard`: HIDE's tasks whose pictures tell what is hidden, with that leak closed."""
