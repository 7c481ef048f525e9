# shellcheck shell=bash
# Sourced by the scripts that check something. Each check adds its counts to one file; the outermost script prints once more what failed, and the
# sum as its last line, `N passed, N failed, N skipped`, however it ends. Its exit code is 0 only where nothing failed.

# add_counts PASSED FAILED SKIPPED
add_counts() { echo "$1 $2 $3" >>"$COTWIN_COUNTS"; }
# counted: prints the sums so far, PASSED FAILED SKIPPED
counted() { awk '{p += $1; f += $2; s += $3} END {print p + 0, f + 0, s + 0}' "$COTWIN_COUNTS"; }
# add_failures: prints the lines of the standard input, which say what failed, and keeps them for the end of the log
add_failures() { tee -a "$COTWIN_COUNTS.failures"; }
export -f add_counts counted add_failures

print_sum() {
  local code=$1 passed failed skipped
  read -r passed failed skipped < <(counted)
  if [[ -s $COTWIN_COUNTS.failures ]]; then
    printf '\nwhat failed:\n'
    cat "$COTWIN_COUNTS.failures"
  fi
  rm -f "$COTWIN_COUNTS" "$COTWIN_COUNTS.failures"
  if ((code != 0 && failed == 0)); then failed=1; fi   # a step that is not a check, for example an installation
  if ((failed > 0 && code == 0)); then code=1; fi
  echo "$passed passed, $failed failed, $skipped skipped"
  exit "$code"
}

if [[ -z ${COTWIN_COUNTS:-} ]]; then
  COTWIN_COUNTS=$(mktemp)
  export COTWIN_COUNTS
  trap 'print_sum $?' EXIT
fi
