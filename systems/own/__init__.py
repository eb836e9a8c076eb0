"""Anybody's simulation: a function in a module of theirs, given a table, returns it bound to the table's recording."""
