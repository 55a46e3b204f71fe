"""The pages of docs/reference that are made from the code: `python tests/support pages`."""
