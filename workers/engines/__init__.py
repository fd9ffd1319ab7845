"""Places where attempts run, a local pool or a Dask cluster; they only place processes."""
