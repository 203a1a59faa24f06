#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""python_package.py PACKAGE VERSION PAGE: what autodoc imports, and the page that asks for it.

PACKAGE becomes a copy of python/earshot in which the compiled modules are made from their type stubs (*.pyi), so that the page needs no build.
"""

import pathlib
import sys

from output import write_if_new

ROOT = pathlib.Path(__file__).resolve().parents[2]

PAGE = """\
Python
======

How to install and use the package: :doc:`../howto/python`.

Responses
---------

.. currentmodule:: earshot

.. autoclass:: Scene
   :members:
   :undoc-members:

.. autoclass:: Source()
   :members:
   :undoc-members:

.. autoclass:: Response()
   :members:
   :undoc-members:

.. autofunction:: measure

Policies
--------

.. autoclass:: Policy
   :members:

Results
-------

{results}
Environments
------------

.. autofunction:: make

.. autofunction:: make_vec

.. autofunction:: env_ids

.. autofunction:: packaged_configs

.. autofunction:: register_envs

.. autoclass:: earshot.single.EarshotEnv()
   :members:
   :undoc-members:

.. autoclass:: earshot.vector.EarshotVectorEnv()
   :members:
   :undoc-members:

.. autofunction:: parallel_env

.. autoclass:: earshot.multi_agent.EarshotParallelEnv()
   :members:
   :undoc-members:

Corpora
-------

How to use them: :doc:`../howto/datasets_loaders`.

.. automodule:: earshot.data
   :members:
   :imported-members:

Configs
-------

.. automodule:: earshot.config
   :members:
   :imported-members:

.. currentmodule:: earshot

Errors
------

.. py:exception:: InputError

   A file, key or value that is wrong; a ``ValueError``.  The message is one line: what, where, what to do.

.. py:exception:: RunError

   A run that fails; a ``RuntimeError``.
"""
RESULTS = ("Arrivals", "Metrics", "EffectDecision", "AccuracyPlan", "AccuracyChoice")


def main(package: pathlib.Path, version: str, page: pathlib.Path) -> None:
    for source in sorted(path for pattern in ("*.py", "config/*.py", "data/*.py", "integrations/*.py") for path in (ROOT / "python/earshot").glob(pattern)):
        write_if_new(package / source.relative_to(ROOT / "python/earshot"), source.read_bytes())
    for stub in sorted((ROOT / "python/earshot").glob("*.pyi")):
        code = "from __future__ import annotations\n" + stub.read_text(encoding="utf-8") + f'\n__version__ = "{version}"\n__compiler__ = ""\n'
        write_if_new(package / stub.with_suffix(".py").name, code)
    write_if_new(page, PAGE.format(results="".join(f".. autoclass:: {name}()\n   :members:\n   :undoc-members:\n\n" for name in RESULTS)))


if __name__ == "__main__":
    main(pathlib.Path(sys.argv[1]), sys.argv[2], pathlib.Path(sys.argv[3]))
