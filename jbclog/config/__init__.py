"""Line files, recipes, jobs files and tasks files: TOML in, checked models out, every mistake with
file, line and key.

Start with `recipe.py`, then `load_recipe.py`; `line.py` is the line file, `recipe_settings.py` what
a session writes.
"""
