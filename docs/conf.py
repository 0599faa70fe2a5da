"""How the documentation becomes a site: `make docs`, which fails on any warning."""

project = "kinemode"
copyright = "the kinemode authors"
extensions = ["myst_parser"]
html_theme = "furo"
html_title = "kinemode"
html_show_sphinx = False
html_copy_source = False
exclude_patterns = ["site"]
myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 4  # links into pages go by GitHub's anchors, so that they work there too
