"""The client of a station in conversation, and every value that a command can carry."""
