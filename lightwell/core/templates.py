"""HTML from templates: the only module that imports Jinja2. Every value is escaped unless it is ``Markup`` itself."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup


class Templates:
    """The templates of a folder, and the filters that they use."""

    def __init__(self, folder: Path, filters: Mapping[str, Callable[..., Any]] | None = None) -> None:
        """Open a folder of templates.

        Args:
            folder: Folder with the templates.
            filters: Functions that the templates call with ``value | name``.
        """
        self._environment = Environment(
            loader=FileSystemLoader(folder),
            autoescape=True,
            undefined=StrictUndefined,
            trim_blocks=True,
            lstrip_blocks=True,
        )
        self._environment.filters |= dict(filters or {})

    def render(self, name: str, **values: Any) -> Markup:
        """Fill in a template.

        Args:
            name: Its file, relative to the folder.
            **values: Variables of the template; one that is missing is an error.

        Returns:
            The text; a template that it is passed to does not escape it again.
        """
        return Markup(self._environment.get_template(name).render(**values))
