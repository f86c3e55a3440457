"""A SLURM of two nodes on this machine, on the loopback device, without accounting, munge or cgroups."""

import os
import shutil
import signal
import socket
import subprocess
import time
from contextlib import contextmanager, suppress
from pathlib import Path

NEEDED = ("slurmctld", "slurmd", "sbatch", "srun", "squeue", "scancel", "scontrol", "sinfo")
CONF = """\
ClusterName=loopback
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={ports[0]}
AuthType=auth/none
CredType=cred/none
MpiDefault=none
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SwitchType=switch/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SchedulerType=sched/backfill
SchedulerParameters=batch_sched_delay=0,sched_min_interval=100000
SlurmUser={user}
SlurmdUser={user}
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool-%n
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd-%n.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd-%n.log
ReturnToService=2
SlurmdTimeout=600
KillWait=2
MinJobAge=60
CompleteWait=0
JobRequeue=1
UnkillableStepTimeout=600
{nodes}
PartitionName=main Nodes=ALL Default=YES MaxTime=INFINITE State=UP OverSubscribe=NO
"""


def missing_programs():
    """The commands of SLURM that are not here."""
    return [command for command in NEEDED if shutil.which(command) is None]


def _free_ports(count):
    probes = [socket.socket() for _ in range(count)]
    for probe in probes:
        probe.bind(("127.0.0.1", 0))
    ports = [probe.getsockname()[1] for probe in probes]
    for probe in probes:
        probe.close()
    return ports


class Slurm:
    """The daemons, each a child of this process, and nothing else, is stopped at the end."""

    def __init__(self, folder, nodes=2):
        self.folder, self.nodes = Path(folder), [f"n{i + 1}" for i in range(nodes)]
        self.processes = {}
        ports, host = _free_ports(1 + nodes), socket.gethostname().partition(".")[0]
        (self.folder / "state").mkdir(parents=True)
        lines = [
            f"NodeName={name} NodeHostname={host} NodeAddr=127.0.0.1 Port={port} CPUs=1 RealMemory=1000 State=UNKNOWN"
            for name, port in zip(self.nodes, ports[1:], strict=True)
        ]
        self.conf = self.folder / "slurm.conf"
        user = os.environ.get("USER") or "root"
        self.conf.write_text(CONF.format(host=host, ports=ports, user=user, folder=self.folder, nodes="\n".join(lines)))
        self.environment = {"SLURM_CONF": str(self.conf)}

    def start(self):
        """Start the controller and all nodes, and wait until they are idle."""
        self.start_controller()
        for node in self.nodes:
            self.start_node(node)
        deadline = time.monotonic() + 60
        while self.states() != dict.fromkeys(self.nodes, "idle"):
            if time.monotonic() > deadline:
                raise TimeoutError(f"nodes are {self.states()}; see {self.folder}/*.log")
            time.sleep(0.2)

    def start_controller(self):
        self._start("slurmctld", ["slurmctld", "-D"])

    def restart_controller(self):
        """End the controller, which saves its state, start it again, and wait until it answers.

        One that is killed forgets the last seconds, and holds what it started in them until an administrator comes.
        """
        controller = self.processes.pop("slurmctld")
        controller.terminate()
        controller.wait()
        self.start_controller()
        deadline = time.monotonic() + 60
        while not self.states():
            if time.monotonic() > deadline:
                raise TimeoutError(f"slurmctld does not answer; see {self.folder}/*.log")
            time.sleep(0.2)

    def start_node(self, node):
        """Start a node's daemon among processes of its own, so that it knows nothing of those of other nodes."""
        own = ["unshare", "--pid", "--fork", "--kill-child", "--mount-proc"] if _may_unshare() else []
        self._start(node, [*own, "slurmd", "-D", "-N", node])

    def _start(self, name, command):
        log = (self.folder / f"{name}.out").open("ab")
        self.processes[name] = subprocess.Popen(
            command, env={**os.environ, **self.environment}, stdout=log, stderr=log, start_new_session=True
        )

    def kill(self, name):
        """Kill a daemon and, of a node, all that runs on it; as if its power was cut."""
        process = self.processes.pop(name)
        for child in reversed(_descendants(process.pid)):
            with suppress(ProcessLookupError):
                os.kill(child, signal.SIGKILL)
        process.kill()
        process.wait()

    def stop(self):
        for name in list(self.processes):
            self.kill(name)

    def states(self):
        """State of each node, such as idle, mixed, down*."""
        text = self.ask("sinfo", "--noheader", "--Node", "--format=%N %t", check=False)
        return dict(line.split() for line in text.splitlines())

    def hurry(self):
        """Let jobs start that SLURM holds back for two minutes since they were queued again."""
        held = self.ask("squeue", "--noheader", "--array", "--states=PENDING", "--format=%i %r").splitlines()
        for job, reason in (line.split(maxsplit=1) for line in held):
            if reason == "BeginTime":
                self.ask("scontrol", "update", f"JobId={job}", "StartTime=now", check=False)

    def ask(self, *command, check=True):
        """What a command of SLURM prints."""
        done = subprocess.run(
            command, env={**os.environ, **self.environment}, capture_output=True, text=True, check=False
        )
        if check and done.returncode:
            raise RuntimeError(f"{' '.join(command)}: {done.stderr}")
        return done.stdout


def _may_unshare():
    tried = subprocess.run(["unshare", "--pid", "--fork", "--mount-proc", "true"], capture_output=True, check=False)
    return tried.returncode == 0


def _descendants(process):
    found = []
    with suppress(FileNotFoundError):
        for task in Path(f"/proc/{process}/task").iterdir():
            for child in (task / "children").read_text().split():
                found += [int(child), *_descendants(int(child))]
    return found


@contextmanager
def running_slurm(folder):
    """A SLURM that is stopped when the context ends."""
    slurm = Slurm(folder)
    try:
        slurm.start()
        yield slurm
    finally:
        slurm.stop()
