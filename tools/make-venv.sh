#!/bin/sh
# Create the virtual environment $1 with a Python >= 3.10; on Debian/Ubuntu as root, install python3-venv when it is missing.
set -eu
venv=$1
[ -x "$venv/bin/python" ] && exit 0
for python in python3 python3.13 python3.12 python3.11 python3.10; do
  if command -v "$python" >/dev/null 2>&1 && "$python" -c 'import sys; sys.exit(sys.version_info < (3, 10))'; then
    found=$python
    break
  fi
done
if [ -z "${found:-}" ]; then
  echo "setup: no Python >= 3.10 found; install one (Debian/Ubuntu: apt-get install python3 python3-venv)" >&2
  exit 2
fi
if ! "$found" -c 'import ensurepip' 2>/dev/null; then
  if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null 2>&1; then
    apt-get update -qq && apt-get install -y -qq --no-install-recommends python3-venv >/dev/null
  else
    echo "setup: this Python cannot make virtual environments; run 'sudo apt-get install python3-venv' and try again" >&2
    exit 2
  fi
fi
# The newest pip: the commands that older ones write import re first, during which Ctrl-C prints a traceback.
"$found" -m venv --upgrade-deps "$venv"
