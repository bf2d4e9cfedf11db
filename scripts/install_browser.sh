#!/usr/bin/env bash
# Chromium, in which the dashboard is tested. Called by `make test`; tests say so where it is missing.
set -euo pipefail
for name in chromium chromium-browser google-chrome; do
  if command -v "$name" >/dev/null; then exit 0; fi
done
if [ "$(uname)" = Linux ] && [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
  echo "installing chromium, in which the dashboard is tested"
  apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends chromium ||
    echo "Chromium could not be installed; the dashboard's tests are skipped" >&2
else
  echo "The dashboard is tested in Chromium, which is missing: sudo apt-get install chromium" >&2
fi
