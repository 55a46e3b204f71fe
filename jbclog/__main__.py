"""``python -m jbclog`` is the command `jbclog`."""

from jbclog.cli import main

if __name__ == "__main__":
    main()
