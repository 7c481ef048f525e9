#!/usr/bin/env bash
# last_turn.sh: prints the commit of the last turn of CI, which is the one before HEAD's that changed .ci/turn; nothing where the history is not there.
set -euo pipefail
cd "$(dirname "$0")/.."
if [[ $(git rev-parse --is-shallow-repository 2>/dev/null) == false ]]; then git log -2 --format=%H -- .ci/turn | sed -n 2p; fi
