#!/usr/bin/env bash
# Run the README's two commands where it says that they run: on a bare Debian 13 with make, git, python3.13 and its venv, by
# a user who is not root. Needs root and debootstrap; changes nothing of this machine but FOLDER.
#   headless/tools/bare_debian.sh [FOLDER] [COMMAND ...]     default: /var/tmp/bare-debian "make demo" "make test"
# The last commit is cloned. The system libraries that `make demo` asks for are installed just as its line says.
# BUSY=2 starts as many busy loops beside the commands.
set -euo pipefail
root=${1:-/var/tmp/bare-debian}
shift $(($# > 0 ? 1 : 0))
[[ $# -gt 0 ]] || set -- "make demo" "make test"
project=$(git -C "$(dirname "$0")" rev-parse --show-toplevel)

complain() {
  echo "bare_debian.sh: $1" >&2
  exit 1
}
[[ $EUID == 0 ]] || complain "debootstrap needs root; run it with sudo"
command -v debootstrap >/dev/null || complain "debootstrap is missing; run: apt-get install debootstrap"

if [[ ! -e $root/.complete ]]; then
  # The mirror that this machine's own apt uses.
  mirror=$(apt-get indextargets --format '$(REPO_URI)' 'Created-By: Packages' | grep -m1 '/debian/\?$')
  rm -rf --one-file-system "$root"
  debootstrap --variant=minbase --include=ca-certificates,make,git,python3.13,python3.13-venv trixie "$root" "$mirror" >&2
  chroot "$root" useradd --create-home --shell /bin/bash guest
  touch "$root/.complete"
fi
cp /etc/resolv.conf "$root/etc/resolv.conf"
cp /etc/ssl/certs/ca-certificates.crt "$root/etc/ssl/certs/ca-certificates.crt"
rm -rf "$root/home/guest/noisy-world" "$root/home/guest/project.bundle"
git -C "$project" bundle create -q "$root/home/guest/project.bundle" HEAD
# How pip and the network are reached from here, and nothing else of this environment.
env | grep -E '^(PIP_(INDEX_URL|EXTRA_INDEX_URL|CERT|DEFAULT_TIMEOUT|TRUSTED_HOST)|https?_proxy|no_proxy)=' |
  sed 's/^/export /' >"$root/home/guest/.network" || true

busy=()
for ((k = 0; k < ${BUSY:-0}; k++)); do
  while :; do :; done &
  busy+=($!)
done
trap '[[ ${#busy[@]} == 0 ]] || kill "${busy[@]}"' EXIT

export root
# A mount namespace of its own, so that nothing stays mounted behind it.
unshare --mount --propagation private bash -euo pipefail -c '
  mount -t proc proc "$root/proc"
  mount --rbind /dev "$root/dev"
  mount -t tmpfs tmpfs "$root/tmp"
  chmod 1777 "$root/tmp"
  as_guest() { chroot "$root" su - guest -c "set -e; . ./.network; cd noisy-world 2>/dev/null || true; $1"; }
  as_guest "git clone -q project.bundle noisy-world"
  for command in "$@"; do
    echo "bare_debian.sh: $command" >&2
    SECONDS=0
    if ! as_guest "$command" 2> >(tee "$root/tmp/said" >&2); then
      packages=$(sed -n "s/.*missing here: .*; run: apt-get install //p" "$root/tmp/said" | tail -n 1)
      [[ -n $packages ]] || exit 1
      [[ ! -e $root/home/guest/noisy-world/.venv ]] || { echo "bare_debian.sh: packages were downloaded before" >&2; exit 1; }
      chroot "$root" apt-get -qq install -y --no-install-recommends $packages >/dev/null
      as_guest "$command"
    fi
    echo "bare_debian.sh: $command ended after $SECONDS s" >&2
  done
' bash "$@"
