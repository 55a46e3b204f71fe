"""`jbclog demo`."""


def demo() -> None:
    """Demo."""
