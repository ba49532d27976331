#!/bin/sh
# Print the path of a Chromium: $CHROMIUM, the system's, else Playwright's own. With --install, get one when there is none:
# from apt when root, else Playwright's download.
set -eu
find_it() {
  for name in "${CHROMIUM:-}" chromium chromium-browser google-chrome google-chrome-stable; do
    if [ -n "$name" ] && command -v "$name" >/dev/null 2>&1; then
      command -v "$name"
      return 0
    fi
  done
  root=$(cd "$(dirname "$0")/.." && pwd)
  path=$(cd "$root/web" && node -e 'process.stdout.write(require("playwright-core").chromium.executablePath())' 2>/dev/null || true)
  [ -n "$path" ] && [ -x "$path" ] && echo "$path"
}
if find_it; then exit 0; fi
if [ "${1:-}" != "--install" ]; then
  echo "test: no Chromium found; run 'tools/find-chromium.sh --install' or set CHROMIUM to one" >&2
  exit 2
fi
if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null 2>&1; then
  apt-get update -qq >&2
  # Debian and Ubuntu name it differently; Ubuntu's chromium-browser is a snap that does not run in containers.
  if apt-get install -y -qq --no-install-recommends chromium libegl1 libgl1-mesa-dri mesa-vulkan-drivers >&2 && find_it; then
    exit 0
  fi
fi
root=$(cd "$(dirname "$0")/.." && pwd)
(cd "$root/web" && npx playwright-core install --with-deps chromium >&2 || npx playwright-core install chromium >&2)
find_it
