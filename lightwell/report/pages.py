"""The templates of the pages, with the filters that format numbers."""

from __future__ import annotations

from pathlib import Path

from lightwell.core.templates import Templates
from lightwell.report import numbers

FILTERS = (numbers.amount, numbers.digits, numbers.duration, numbers.flat, numbers.grouped, numbers.percent)
TEMPLATES = Templates(Path(__file__).parent / "templates", {form.__name__: form for form in FILTERS})
