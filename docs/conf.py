"""The documentation site: `.ci/docs` builds it into build/docs, and every warning is an error."""

project = "jbclog"
copyright = "jbclog maintainers, MIT licence"  # noqa: A001  # Sphinx reads this name
html_title = "jbclog"
language = "en"

extensions = ["myst_parser"]
exclude_patterns = ["decisions/0000-template.md"]
myst_heading_anchors = 4
smartquotes = False  # "--json" stays as it is typed

html_theme = "furo"
html_static_path = ["style"]
html_css_files = ["jbclog.css"]
html_copy_source = False
html_show_sourcelink = False
