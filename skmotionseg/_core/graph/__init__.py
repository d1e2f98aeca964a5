"""Affinities of tracks: made, sparsified, embedded, clustered and cut."""
