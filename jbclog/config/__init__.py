"""Read and check line files, recipes, jobs files and tasks files: TOML to typed models, every
mistake with file, line and key.

Start with `recipe.py`, then `load_recipe.py`; `line.py` is the line file, `recipe_settings.py` the
settings that a session writes.
"""
