"""Scripts that print one table each: time beside error, ours beside a peer or a slow reference."""
