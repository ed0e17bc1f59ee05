#!/bin/sh
# Make a Python environment, or bring one up to date, with the packages of a file of requirements.
#   environment.sh PYTHON FOLDER PIP-OPTION...
# What was made half, since something ended it or failed, is made anew the next time: a file in the folder says that it
# is unfinished. What is wrong is one line. Run by `make`.
set -u
python=$1 folder=$2
shift 2

complain() {
  echo "make: $1" >&2
  exit 1
}

has_pip() { "$folder/bin/python" -c 'import pip' >/dev/null 2>&1; }

# pip warns of a cache that it cannot write to, as under a home folder that is not there: it then goes without.
can_cache() {
  cache=${PIP_CACHE_DIR:-${XDG_CACHE_HOME:-${HOME:-}/.cache}/pip}
  mkdir -p "$cache" 2>/dev/null && [ -O "$cache" ] && [ -w "$cache" ]
}

make_environment() {
  rm -rf "$folder"
  mkdir -p "$folder" && : >"$folder/.unfinished" || complain "$folder cannot be made here"
  said=$("$python" -m venv "$folder" 2>&1) && has_pip && return
  rm -rf "$folder"
  package=$("$python" -c 'import sys; print("python%d.%d-venv" % sys.version_info[:2])' 2>/dev/null)
  case $said in
    *ensurepip* | *"No module named venv"* | "")
      complain "$python cannot make $folder, for it comes without pip: install Debian's ${package:-python3-venv}, or say PYTHON=/path/to/another" ;;
  esac
  complain "$python cannot make $folder: $(echo "$said" | tail -n 1)"
}

if [ -e "$folder/.unfinished" ] || ! has_pip; then
  make_environment
fi
can_cache || set -- --no-cache-dir "$@"
rm -f "$folder/.installed"
: >"$folder/.unfinished"
# One line for each package that pip downloads, with its size; for the largest also how far it is.
tell() {
  total=$(cat "$@" 2>/dev/null | grep -c '^[A-Za-z0-9_.-]*\(\[[^]]*\]\)\{0,1\}==')
  awk -v folder="$folder" -v total="$total" '
    function say(text) { print "make: " folder ": " text; fflush() }
    /^ *Collecting / { n++; if (n > total) total = n }
    /^ *Downloading / { size = $NF == "MB)" || $NF == "kB)" ? $(NF - 1) " " $NF : $NF; gsub(/[()]/, "", size)
      name = $2; sub(/.*\//, "", name); split(name, part, "-"); quarter = 1
      say("package " n " of " total ": " part[1] " " part[2] ", " size) }
    /^Progress / { if ($4 > 5e7 && $2 < $4 && $2 >= $4 * quarter / 4) { say("  " 25 * quarter " %"); quarter++ } }
    /^Installing collected packages/ { say("unpacking " split($0, names, ",") " packages") }' >&2
}

# What pip puts on a line to be read: from 24.1 on also how far a download is.
bar=$("$folder/bin/python" -c 'import pip; print("raw" if tuple(map(int, pip.__version__.split(".")[:2])) >= (24, 1) else "off")' 2>/dev/null)

# Python compiles what is imported, a fifth of what is installed; to compile all of it takes longer than to unpack it.
for file; do :; done
{
  "$folder/bin/python" -m pip install --no-compile --disable-pip-version-check --progress-bar "${bar:-off}" "$@"
  echo $? >"$folder/.status"
} | tell "$file"
[ "$(cat "$folder/.status")" = 0 ] ||
  complain "the packages of $folder could not be installed, for the reason above; the next make begins anew"
rm -f "$folder/.status" "$folder/.unfinished"
