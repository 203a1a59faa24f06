# SPDX-License-Identifier: Apache-2.0
"""Sphinx configuration of the site.  scripts/docs.sh assembles the pages and names folders and version in the environment."""

import os
import re

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
# Not errors: a level of headings that is left out, a block that its lexer does not know whole (an ellipsis in JSON), and the namespace, which each
# header opens.
suppress_warnings = ["myst.header", "misc.highlighting_failure", "duplicate_declaration.cpp"]

breathe_projects = {"earshot": os.environ["EARSHOT_DOCS_XML"]}
breathe_default_project = "earshot"
breathe_default_members = ("members",)
breathe_show_include = False
cpp_maximum_signature_line_length = 100

autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
autodoc_type_aliases = {"ArrayLike": "ArrayLike"}
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


ARRAY = r"~?(?:numpy\.)?ndarray\[tuple\[~?(?:typing\.)?Any, \.\.\.\], ~?(?:numpy\.)?dtype\[~?(?:numpy\.)?(\w+)\]\]"


def shorten_arrays(app, what, name, obj, options, signature, returned):
    """Arrays as the sources name them: NDArray[float32]."""

    def short(text):
        return text and re.sub(ARRAY, r"NDArray[\1]", text)

    return short(signature), short(returned)


def setup(app):
    app.connect("autodoc-process-signature", shorten_arrays)
