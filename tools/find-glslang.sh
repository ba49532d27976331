#!/bin/sh
# Print the path of glslang's compiler: $GLSLANG or the system's. With --install, get it from apt when root, with a Vulkan driver
# for the processor beside it. Only the tests of printed HLSL need it.
set -eu
find_it() {
  for name in "${GLSLANG:-}" glslangValidator glslang; do
    if [ -n "$name" ] && command -v "$name" >/dev/null 2>&1; then
      command -v "$name"
      return 0
    fi
  done
  return 1
}
if find_it; then exit 0; fi
if [ "${1:-}" = "--install" ] && [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null 2>&1; then
  apt-get update -qq >&2
  apt-get install -y -qq --no-install-recommends glslang-tools mesa-vulkan-drivers >&2 && find_it && exit 0
fi
echo "test: no glslang found; install it (Debian, Ubuntu: glslang-tools; macOS: brew install glslang) or set GLSLANG to it" >&2
exit 2
