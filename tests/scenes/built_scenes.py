"""Built-in scenes that several files of tests look at, each built once."""

import functools

from lightwell.scenes.builtin import build

built = functools.cache(build)
