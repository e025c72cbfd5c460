#!/bin/sh
# Installs what VTK draws with where there is no display (EGL and a software GL driver).
# Run it as root on Debian; it is quick when there is nothing to do.
set -eu

packages="libegl1 libgl1 libgl1-mesa-dri libxrender1"
missing=""
for package in $packages; do
    dpkg-query -W -f '${Status}' "$package" 2>/dev/null | grep -q 'ok installed' || missing="$missing $package"
done
if [ -z "$missing" ]; then
    echo "install_drawing: nothing to do"
    exit 0
fi
export DEBIAN_FRONTEND=noninteractive
apt-get update -qq
# shellcheck disable=SC2086 # a list of packages
apt-get install -y -qq --no-install-recommends $missing > /dev/null
echo "install_drawing: installed$missing"
