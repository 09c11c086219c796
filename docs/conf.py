# SPDX-License-Identifier: Apache-2.0
"""The documentation's site: `./sixstrut docs`. Strict, and nothing in it comes from the network when it is read."""

project = "sixstrut"
author = "sixstrut maintainers"
copyright = author
extensions = ["myst_parser"]
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = "sixstrut"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sphinx = False
html_copy_source = False
html_theme_options = {"navigation_with_keys": True}
myst_heading_anchors = 3  # links to headings work here as they do on a Git host
