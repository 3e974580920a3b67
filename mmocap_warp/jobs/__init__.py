"""Many jobs, done by processes of this machine or by a Ray cluster: each once, whatever dies on the way."""
