#!/bin/sh
# Say clearly when Node >= 20 is missing: only the tests need it.
set -eu
if ! command -v node >/dev/null 2>&1; then
  echo "test: Node >= 20 is needed for the web tests; install it from your distribution or nodejs.org" >&2
  exit 2
fi
major=$(node -p 'process.versions.node.split(".")[0]')
if [ "$major" -lt 20 ]; then
  echo "test: Node $major is too old for the web tests; install Node >= 20" >&2
  exit 2
fi
