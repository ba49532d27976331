"""A directive that shows the help of a verb, as the program prints it: ``{verb-help} bake``."""

from __future__ import annotations

import os
from typing import Any

from docutils import nodes
from docutils.parsers.rst import Directive
from sphinx.application import Sphinx

from lightwell.cli.main import verb_parser

# Columns of the help on the site; Python's argparse reads them from the environment.
COLUMNS = "110"


class VerbHelp(Directive):
    """The text of ``lightwell VERB --help``, or of a tool of the verb: ``lightwell lens bake --help``."""

    required_arguments = 1
    optional_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Make the text.

        Returns:
            One literal block.
        """
        before = os.environ.get("COLUMNS")
        os.environ["COLUMNS"] = COLUMNS
        try:
            text = verb_parser(self.arguments[0], self.arguments[1:]).format_help()
        finally:
            os.environ.pop("COLUMNS") if before is None else os.environ.update(COLUMNS=before)
        block = nodes.literal_block(text, text)
        block["language"] = "text"
        return [block]


def setup(app: Sphinx) -> dict[str, Any]:
    """Add the directive.

    Args:
        app: The application.

    Returns:
        Facts about the extension.
    """
    app.add_directive("verb-help", VerbHelp)
    return {"parallel_read_safe": True, "version": "1"}
