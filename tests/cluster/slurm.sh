#!/usr/bin/env bash
# A Slurm of one node on this machine, for as long as a test needs it: slurm.sh DIR COMMAND [ARGUMENT]...
# Runs the command with SLURM_CONF set, and stops what it started, whatever happens. Everything it writes is below DIR.
# Needs root, as slurmd does.
set -euo pipefail
place=$(mkdir -p "$1" && cd "$1" && pwd)
shift

started=()
stop() {
    # In reverse: slurmd, slurmctld, munged.
    for ((at = ${#started[@]} - 1; at >= 0; at--)); do
        kill "${started[at]}" 2>/dev/null || true
    done
    for daemon in "${started[@]}"; do
        for _ in $(seq 100); do kill -0 "$daemon" 2>/dev/null || break; sleep 0.1; done
        kill -KILL "$daemon" 2>/dev/null || true
    done
}
trap stop EXIT

# Munge trusts only directories that nobody else can write to, /tmp among their parents is not one.
mkdir -p "$place/munge" "$place/state" "$place/spool"
chmod 755 "$place/munge" "$place/state" "$place/spool"
dd if=/dev/urandom of="$place/munge/key" bs=1024 count=1 status=none
chmod 400 "$place/munge/key"
# Ours, by a socket of its own: one of the machine stays as it is.
munged --foreground --force --key-file="$place/munge/key" --socket="$place/munge/socket" --pid-file="$place/munge/pid" \
    --log-file="$place/munge/log" --seed-file="$place/munge/seed" >"$place/munge/out" 2>&1 &
started+=($!)
for _ in $(seq 100); do [ -S "$place/munge/socket" ] && break; sleep 0.1; done
[ -S "$place/munge/socket" ] || { cat "$place/munge/out" "$place/munge/log" >&2; exit 1; }

node=$(hostname -s)
# Ports of our own, so that several tests, or a real Slurm, can be here at once.
port=$((20000 + RANDOM % 20000))
cat >"$place/slurm.conf" <<END
ClusterName=test
SlurmctldHost=$node(127.0.0.1)
SlurmUser=root
SlurmctldPort=$port
SlurmdPort=$((port + 1))
AuthType=auth/munge
AuthInfo=socket=$place/munge/socket
CredType=cred/munge
StateSaveLocation=$place/state
SlurmdSpoolDir=$place/spool
SlurmctldPidFile=$place/slurmctld.pid
SlurmdPidFile=$place/slurmd.pid
SlurmctldLogFile=$place/slurmctld.log
SlurmdLogFile=$place/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
MinJobAge=3600
ReturnToService=2
SchedulerParameters=sched_interval=1,batch_sched_delay=0,bf_interval=1
KillWait=5
MessageTimeout=10
NodeName=$node NodeAddr=127.0.0.1 CPUs=$(nproc) State=UNKNOWN
PartitionName=test Nodes=$node Default=YES MaxTime=INFINITE State=UP OverSubscribe=FORCE:4
END
export SLURM_CONF=$place/slurm.conf
slurmctld -D >"$place/slurmctld.out" 2>&1 &
started+=($!)
slurmd -D -N "$node" >"$place/slurmd.out" 2>&1 &
started+=($!)
for _ in $(seq 300); do
    state=$(sinfo -h -o %t 2>/dev/null || true)
    case $state in idle | mix | alloc) break ;; esac
    sleep 0.1
done
case $state in
    idle | mix | alloc) ;;
    *)
        tail -n 40 "$place"/slurm*.log "$place"/slurm*.out >&2
        printf 'slurm.sh: the node is not ready: %s\n' "${state:-nobody answers}" >&2
        exit 1
        ;;
esac
"$@"
