#!/bin/sh
# Installs the system libraries that Open3D loads, a Vulkan driver and a browser for the tests, and venv where Debian's Python lacks it. Without the right to do so
# it prints the one line to run and fails. Usage: system-libraries.sh PYTHON
set -u
PACKAGES="libusb-1.0-0 libgl1 libegl1 libgomp1 libx11-6 mesa-vulkan-drivers chromium"
command -v dpkg-query >/dev/null || { echo "Not a Debian system: you need the libraries of: $PACKAGES" >&2; exit 0; }
"$1" -c 'import ensurepip' 2>/dev/null || PACKAGES="$PACKAGES python3-venv"
missing=
for package in $PACKAGES; do
	dpkg-query -W -f '${Status}' "$package" 2>/dev/null | grep -q 'ok installed' || missing="$missing $package"
done
[ -n "$missing" ] || exit 0
install="apt-get update && apt-get install -y --no-install-recommends$missing"
if [ "$(id -u)" = 0 ]; then
	sh -c "export DEBIAN_FRONTEND=noninteractive; $install" >&2
elif command -v sudo >/dev/null && sudo -n true 2>/dev/null; then
	sudo sh -c "export DEBIAN_FRONTEND=noninteractive; $install" >&2
else
	printf 'System packages are missing. Run this once, then start again:\n\n    sudo sh -c "%s"\n\n' "$install" >&2
	exit 1
fi
