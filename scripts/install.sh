#!/usr/bin/env bash
# Makes the virtual environment $1 and installs everything into it. Called by `make install`.
set -euo pipefail
venv=$1
python=${PYTHON:-python3}

"$python" - <<'PY' || exit 1
import sys
if sys.version_info < (3, 11):
    sys.exit(f"HELIOS needs Python 3.11 or newer; this is {sys.version.split()[0]}: set PYTHON=…")
PY

# The simulator draws with OpenGL through EGL; on a machine without a GPU Mesa does it.
needed="libegl1 libegl-mesa0 libgl1-mesa-dri"
if [ "$(uname)" = Linux ] && ! PATH="$PATH:/sbin:/usr/sbin" ldconfig -p | grep -q libEGL_mesa; then
  if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
    echo "installing Mesa's EGL, with which the simulator draws: $needed"
    apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $needed
  else
    echo "The simulator needs Mesa's EGL: sudo apt-get install $needed" >&2
  fi
fi

echo "installing into $venv: about three minutes and 3.4 GB (more with a CUDA build of torch) the first time"
[ -x "$venv/bin/python" ] || "$python" -m venv "$venv"
# Of all that pip says: what it fetches, and that it then unpacks (the longest silence).
"$venv/bin/python" -m pip install --progress-bar off --disable-pip-version-check \
  --constraint constraints.txt --editable '.[all,dev]' \
  | sed -nu -e 's/^ *Downloading \([^ ]*\) \(.*\)/  fetching \1 \2/p' \
            -e 's/^Installing collected packages.*/  unpacking all of them: a minute/p' \
            -e 's/^Successfully installed.*/  done/p'
