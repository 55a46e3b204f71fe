"""An index of runs in the user's cache folder, for folders of thousands of runs. Start with
`run_index.py`.

It is a cache: every answer is the same without it.
"""
