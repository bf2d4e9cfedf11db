#!/usr/bin/env bash
# Makes the virtual environment $1 with ROS 2's rclpy and what driver and output need of HELIOS.
# Once: a second call with the same pyproject.toml does nothing. Called by `make ros2-env`.
set -euo pipefail
venv=$1
python=${PYTHON:-python3}
done=$venv/.installed

if [ "$(uname -sm)" != "Linux x86_64" ]; then
  echo "pip has rclpy for Linux on x86-64 only; source your ROS 2 instead, see docs/tutorials/your-ros2-robot.md" >&2
  exit 1
fi
if [ -e "$done" ] && [ ! pyproject.toml -nt "$done" ] && [ ! constraints.txt -nt "$done" ]; then
  exit 0
fi
echo "installing ROS 2's rclpy and HELIOS' driver into $venv: half a minute and 450 MB"
[ -x "$venv/bin/python" ] || "$python" -m venv "$venv"
"$venv/bin/python" -m pip install --quiet --disable-pip-version-check \
  --constraint constraints.txt --editable '.[ros2,ros,contract]'
"$venv/bin/python" -c "import rclpy" && touch "$done"
