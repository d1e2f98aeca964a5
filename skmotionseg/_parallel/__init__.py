"""Tasks in threads, processes and clusters, with one native thread each."""
