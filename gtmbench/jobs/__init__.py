"""Long work: spread over processes or a cluster, kept part by part, with progress."""
