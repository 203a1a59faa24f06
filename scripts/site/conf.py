"""Sphinx configuration of the site.  scripts/docs.sh assembles the pages and names folders and version in the environment."""

import os

project = "Earshot"
author = "The Earshot maintainers"
copyright = author
version = release = os.environ["EARSHOT_DOCS_VERSION"]
language = "en"

extensions = ["myst_parser", "breathe", "sphinx.ext.autodoc", "sphinx_copybutton"]
root_doc = "index"
highlight_language = "text"
# `--out` stays two hyphens.
smartquotes = False

myst_heading_anchors = 4
myst_enable_extensions = ["deflist"]
# A level that is left out, and a block that its lexer does not know whole (an ellipsis in JSON), are no errors.
suppress_warnings = ["myst.header", "misc.highlighting_failure"]

breathe_projects = {"earshot": os.environ["EARSHOT_DOCS_XML"]}
breathe_default_project = "earshot"
breathe_default_members = ("members",)
cpp_maximum_signature_line_length = 100

autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
python_maximum_signature_line_length = 100
python_use_unqualified_type_names = True
# The classes that environments derive from.
autodoc_mock_imports = ["gymnasium", "pettingzoo"]

copybutton_prompt_text = "$ "
copybutton_only_copy_prompt_lines = True

html_theme = "furo"
html_title = f"Earshot {version}"
html_static_path = [os.environ["EARSHOT_DOCS_STATIC"]]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sphinx = False
html_show_copyright = False
html_theme_options = {"navigation_with_keys": True}
