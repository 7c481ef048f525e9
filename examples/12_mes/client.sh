#!/bin/sh
# The same questions with curl: client.sh URL [CURL_OPTION…], for example client.sh http://127.0.0.1:8080
set -eu
url=$1
shift
ask() {
  curl --silent --show-error --fail-with-body --header 'Content-Type: application/json' "$@"
}
request='"robot":"lwr4","from_q_rad":[0,-0.9,0,1.2,0,0.6,0],"to_q_rad":[1.2,0.9,0,-1.2,0,-0.6,0]'

echo "1. is the move possible in 2.0 s?"
ask "$@" --data "{$request,\"T_s\":2.0}" "$url/services/feasibility"
echo "   and how fast can it be, and what does that cost? (order.json, for an operator)"
ask "$@" --data "@$(dirname "$0")/order.json" "$url/services"
echo "2. order a better motion; wait for it"
ask "$@" --header 'Prefer: respond-async, wait=20' --data "{$request,\"T_min_s\":2.0,\"degree\":7,\"particles\":16,\"rounds\":10}" "$url/services/optimise"
echo "3. jobs that are done"
ask "$@" "$url/job-orders?state=Ended&limit=5"
