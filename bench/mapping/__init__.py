"""The mapper beside its peers: `python -m bench.mapping`."""
