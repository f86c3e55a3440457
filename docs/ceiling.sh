#!/bin/sh
# The manual stays one that a person reads: whoever adds to it also cuts. Findings go to results/ and lab/.
check() { # what it is, its words, how many are allowed
  [ "$2" -le "$3" ] || { echo "$1 has $2 words, $3 at most: shorten it, or move findings to results/ or lab/" >&2; exit 1; }
}
check docs/ "$(find docs -name '*.md' -exec cat {} + | wc -w)" 25000
check README.md "$(wc -w < README.md)" 700
check lab/ "$(find lab -name '*.md' -exec cat {} + | wc -w)" 15000
