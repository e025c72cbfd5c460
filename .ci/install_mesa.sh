#!/bin/sh
# Installs Mesa's software Vulkan driver (lavapipe), on which the GPU halves of the kernels
# are tested where there is no GPU.
#
# Mesa must be 24 or later: older ones end shader loops after 65,535 turns without a word.
# Debian 12 carries 22.3, so there the driver comes from bookworm-backports, at the place
# where this machine already gets its packages. Run it as root; it is quick when there is
# nothing to do. Where it cannot install, it says what to install and fails only if CI=true.
set -eu

wanted=24
part=/etc/apt/sources.list.d/dressform-backports

major() { dpkg-query -W -f '${Version}' "$1" 2>/dev/null | sed 's/^[0-9]*://; s/[^0-9].*//'; }
fits() { v=$(major mesa-vulkan-drivers || true); [ -n "$v" ] && [ "$v" -ge "$wanted" ]; }
loader() { dpkg-query -W -f '${Status}' libvulkan1 2>/dev/null | grep -q 'ok installed'; }

give_up() {
    echo "install_mesa: $1" >&2
    echo "install_mesa: the GPU tests need a Vulkan loader and a driver: a GPU's own, or Mesa's lavapipe $wanted or later" >&2
    echo "install_mesa: (Debian, Ubuntu: libvulkan1 mesa-vulkan-drivers; Fedora: vulkan-loader mesa-vulkan-drivers; Arch: vulkan-icd-loader vulkan-swrast)" >&2
    if [ "${CI:-}" = true ]; then exit 1; else exit 0; fi
}

# The release's own entry, under the name of its backports. In deb822 files a stanza is a
# paragraph; in one-line files it is a line.
backports_deb822() {
    awk -v suite="$1" 'BEGIN { RS = ""; FS = "\n" }
        {
            ours = 0; off = 0; text = ""
            for (i = 1; i <= NF; i++) {
                if ($i ~ /^#/) continue
                if ($i ~ /^Enabled: *no/) off = 1
                if ($i ~ /^Suites:/) {
                    n = split($i, words, /[ \t]+/)
                    for (k = 2; k <= n; k++) if (words[k] == suite) ours = 1
                    $i = "Suites: " suite "-backports"
                }
                if ($i ~ /^Types:/) $i = "Types: deb"
                text = text $i "\n"
            }
            if (ours && !off) { printf "%s", text; exit }
        }' "$2"
}

backports_line() {
    sed -n -E "s#^(deb[[:space:]]+(\[[^]]*\][[:space:]]+)?[^[:space:]]+)[[:space:]]+$1([[:space:]].*)\$#\1 $1-backports\3#p" "$2" | head -n 1
}

add_backports() {
    for file in /etc/apt/sources.list.d/*.sources; do
        [ -f "$file" ] || continue
        entry=$(backports_deb822 "$1" "$file")
        if [ -n "$entry" ]; then
            printf '%s\n' "$entry" > "$part.sources"
            return 0
        fi
    done
    for file in /etc/apt/sources.list /etc/apt/sources.list.d/*.list; do
        [ -f "$file" ] || continue
        entry=$(backports_line "$1" "$file")
        if [ -n "$entry" ]; then
            printf '%s\n' "$entry" > "$part.list"
            return 0
        fi
    done
    return 1
}

candidate() { apt-cache policy mesa-vulkan-drivers | sed -n 's/^ *Candidate: *//p' | sed 's/^[0-9]*://; s/[^0-9].*//'; }

if command -v dpkg-query >/dev/null && fits && loader; then
    echo "install_mesa: Mesa $(major mesa-vulkan-drivers) stands"
    exit 0
fi
[ -f /etc/debian_version ] && command -v apt-get >/dev/null || give_up "not a Debian machine"
[ "$(id -u)" = 0 ] || give_up "not root"

export DEBIAN_FRONTEND=noninteractive
[ -n "$(candidate)" ] || apt-get update -qq || give_up "apt-get update failed"
have=$(candidate)
if [ -n "$have" ] && [ "$have" -ge "$wanted" ]; then
    apt-get install -y -qq --no-install-recommends libvulkan1 mesa-vulkan-drivers >/dev/null || give_up "apt-get failed"
else
    release=$(. /etc/os-release && echo "${VERSION_CODENAME:-}")
    [ -n "$release" ] && add_backports "$release" || give_up "no apt source of $release to derive its backports from"
    apt-get update -qq || give_up "no backports of $release where this machine gets its packages"
    apt-get install -y -qq --no-install-recommends -t "$release-backports" libvulkan1 mesa-vulkan-drivers >/dev/null \
        || give_up "apt-get failed"
fi
fits && loader || give_up "Mesa is still older than $wanted"
echo "install_mesa: Mesa $(major mesa-vulkan-drivers) installed"
