#!/bin/sh
# slurm.sh COMMAND...: runs the command on a Slurm of its own, a controller and two nodes on this machine, which ends with it. Without a command:
# the study of example 26. Nothing of a Slurm that is installed here is touched, and no rights are needed: own ports, own key, own folder.
# CLUSTER: that folder, with the logs, process numbers (*.pid) and slurm.conf, as the command sees it; CPUS: of each node (default: half of this machine).
set -eu
here=$(cd "$(dirname "$0")" && pwd)
. "$here/../common.sh"
PATH=$PATH:/usr/sbin:/sbin

for program in munged slurmctld slurmd sbatch; do
  command -v "$program" >/dev/null && continue
  echo "$0: no program '$program' (Debian packages slurmctld slurmd slurm-client munge: $top/scripts/install.sh cluster)" >&2
  exit 77
done

if [ $# -eq 0 ]; then set -- "$COTWIN" farm "$here/../26_uncertain_insertion/uncertain_insertion.json" --on slurm; fi

CLUSTER=$(mktemp -d /tmp/cotwin_slurm.XXXXXX)   # a short path: the name of a socket has 107 characters at most
export CLUSTER SLURM_CONF="$CLUSTER/slurm.conf"
me=$(id -un) host=$(hostname -s)
port=$((20000 + $$ % 10000))
cpus=${CPUS:-$((($(nproc) + 1) / 2))}
mkdir "$CLUSTER/state"
dd if=/dev/urandom of="$CLUSTER/munge.key" bs=64 count=1 2>/dev/null
chmod 600 "$CLUSTER/munge.key"
chmod 711 "$CLUSTER"
cat >"$SLURM_CONF" <<END
ClusterName=cotwin
SlurmctldHost=$host(127.0.0.1)
SlurmUser=$me
SlurmdUser=$me
AuthType=auth/munge
AuthInfo=socket=$CLUSTER/munge.socket
CredType=cred/munge
SlurmctldPort=$port
StateSaveLocation=$CLUSTER/state
SlurmdSpoolDir=$CLUSTER/%n
SlurmctldPidFile=$CLUSTER/slurmctld.pid
SlurmdPidFile=$CLUSTER/%n.pid
SlurmctldLogFile=$CLUSTER/slurmctld.log
SlurmdLogFile=$CLUSTER/%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SlurmdParameters=config_overrides
SchedulerParameters=sched_min_interval=0,batch_sched_delay=0,sched_interval=1,bf_interval=1
ReturnToService=2
SlurmdTimeout=30
KillWait=5
NodeName=n1 NodeHostname=$host NodeAddr=127.0.0.1 Port=$((port + 1)) CPUs=$cpus
NodeName=n2 NodeHostname=$host NodeAddr=127.0.0.1 Port=$((port + 2)) CPUs=$cpus
PartitionName=all Nodes=n1,n2 Default=YES State=UP
END

fail() {
  echo "$0: $*" >&2
  tail -n 5 "$CLUSTER"/*.log >&2 || true
  exit 77
}
end() {
  code=$?
  trap - EXIT HUP INT TERM
  scancel --user="$me" 2>/dev/null || true
  for file in "$CLUSTER/slurmctld.pid" "$CLUSTER/n1.pid" "$CLUSTER/n2.pid" "$CLUSTER/munged.pid"; do
    [ -f "$file" ] || continue
    process=$(cat "$file")
    kill "$process" 2>/dev/null || true
    for wait in 1 2 3 4 5 6 7 8 9 10; do kill -0 "$process" 2>/dev/null && sleep 0.5; done
    kill -9 "$process" 2>/dev/null || true
  done
  rm -rf "$CLUSTER"
  exit "$code"
}
trap end EXIT
trap 'exit 129' HUP
trap 'exit 130' INT
trap 'exit 143' TERM

munged --force --key-file="$CLUSTER/munge.key" --socket="$CLUSTER/munge.socket" --pid-file="$CLUSTER/munged.pid" \
  --log-file="$CLUSTER/munged.log" --seed-file="$CLUSTER/munge.seed" 2>"$CLUSTER/munged.err" || fail "munged does not start: $(cat "$CLUSTER/munged.err")"
slurmctld -c -f "$SLURM_CONF" || fail "slurmctld does not start"
for node in n1 n2; do slurmd -N "$node" -f "$SLURM_CONF" || fail "slurmd does not start"; done
for wait in $(seq 60); do
  [ "$(sinfo --noheader --format=%T 2>/dev/null)" = idle ] && break
  [ "$wait" -lt 60 ] || fail "the nodes are not idle after 30 s: $(sinfo 2>&1)"
  sleep 0.5
done
"$@"
