"""Processes that run the tasks of a study: here, or on a cluster by Dask.

Each generator yields a task with the message of its failure (None if it is done), or None every second or so in which
nothing ends, so that the caller can check signals and clocks. Closing it ends the processes.
"""

from __future__ import annotations

import contextlib
import importlib.util
import inspect
import json
import queue
import shutil
import signal
import threading
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from multiprocessing import connection
from typing import Any

from ..errors import InputError, install_extra, nearest
from ..tools.processes import ProcessDied, Worker
from .plan import ClusterSection
from .task import Task

Done = Iterator[tuple[Task, str | None] | None]
TRIES = 3
"""Workers that a run may take down with it before it counts as failed."""
ANSWER = 10.0
"""Seconds in which a scheduler has to answer."""
COMMANDS = {"slurm": "sbatch", "pbs": "qsub", "sge": "qsub", "lsf": "bsub"}


def in_process(tasks: Sequence[Task], threads: int) -> Done:
    """Do the runs one after another in this process."""
    for task in tasks:
        yield task, task.perform(threads)


def pool(tasks: Sequence[Task], workers: int, threads: int) -> Done:
    """Runs in processes of this machine; one that is killed is replaced, and its run done again."""
    waiting, lost, idle = deque(tasks), Counter[str](), [Worker() for _ in range(workers)]
    busy: dict[Any, tuple[Worker, Task | None]] = {}

    def call(task: Task | None) -> None:
        worker = idle.pop()
        busy[worker.line] = worker, task
        worker.call(_attempt, tasks[0].warm if task is None else task.perform, threads)

    try:
        call(None)  # compiles the kernels, which the others find
        while busy:
            ready = connection.wait(list(busy), timeout=1.0)
            if not ready:
                yield None
                continue
            for line in ready:
                worker, task = busy.pop(line)
                found = worker.result()
                if isinstance(found, ProcessDied):
                    worker.end()
                    worker = Worker()
                    found = f"{found.reason}, {TRIES} times"
                    if task is not None:
                        lost[task.key] += 1
                        if lost[task.key] < TRIES:
                            waiting.append(task)
                            task = None
                idle.append(worker)
                if task is not None:
                    yield task, found
            while waiting and idle:
                call(waiting.popleft())
    finally:
        for worker in (*idle, *(worker for worker, _ in busy.values())):
            worker.end()


def _attempt(work: Callable[[int], str | None], threads: int) -> str | None:
    """Message of a run that failed."""
    try:
        return work(threads)
    except Exception as error:
        # Whatever goes wrong in one run must not end the others of the study. Nothing is hidden: the message is
        # reported at once and stored in the results of the run, which has no numbers there, and the run is tried again
        # next time.
        return repr(error)


def has_dask() -> bool:
    """True if the extra `study` is installed."""
    return importlib.util.find_spec("distributed") is not None


def dask(
    tasks: Sequence[Task], cluster: ClusterSection, workers: int, threads: int, log: Callable[[str], None]
) -> Done:
    """Runs on a cluster of Dask: one of this machine, one that a scheduler has, or jobs of a batch system.

    Raises InputError if the cluster does not answer, or cannot be asked.
    """
    if not has_dask():
        raise InputError(f"Dask is not installed, which this cluster needs: {install_extra('cluster')}")
    import distributed
    from distributed.comm import get_address_host_port

    with contextlib.ExitStack() as stack:
        if cluster.scheduler is not None:
            pool: Any = cluster.scheduler
            try:
                if not str(pool).startswith("inproc://"):  # a cluster of this process has no port
                    get_address_host_port(pool)
            except ValueError as error:  # a client would fail too, and then wait for its own end
                text = f"is no address such as tcp://host:8786: {error}"
                raise InputError(f"scheduler {pool}: {text}") from None
        elif cluster.kind is not None:
            pool = stack.enter_context(_jobs(cluster, threads))
            pool.scale(jobs=cluster.jobs)
        else:
            local = distributed.LocalCluster(
                n_workers=workers, threads_per_worker=1, processes=True, memory_limit=0,
                dashboard_address="127.0.0.1:0", silence_logs=50,
            )  # fmt: skip
            pool = stack.enter_context(local)
        try:
            client = stack.enter_context(distributed.Client(pool, timeout=ANSWER, set_as_default=False))
        except (OSError, ValueError) as error:
            reason = str(error).splitlines()[0] if str(error) else "no answer"
            where = f"scheduler {cluster.scheduler}: does not answer within {ANSWER:g} s"
            raise InputError(f"{where}: {reason}") from None

        class IgnoreInterrupts(distributed.WorkerPlugin):
            """Plugin of Dask by which workers ignore Ctrl-C."""

            def setup(self, worker: Any) -> None:
                if threading.current_thread() is threading.main_thread():
                    # Ctrl-C is for the process that started the workers.
                    signal.signal(signal.SIGINT, signal.SIG_IGN)

        client.register_plugin(IgnoreInterrupts())
        log(f"dashboard: {client.dashboard_link}")
        ended: queue.SimpleQueue[tuple[Task | None, Any]] = queue.SimpleQueue()

        def submit(task: Task | None) -> None:
            work = tasks[0].warm if task is None else task.perform
            future = client.submit(work, threads, pure=False)
            held[future.key] = future
            future.add_done_callback(lambda future: ended.put((task, future)))

        waiting = False
        held: dict[str, Any] = {}  # Dask drops futures without a reference
        submit(None)  # compiles the kernels, which the others find
        while held:
            try:
                task, future = ended.get(timeout=1.0)
            except queue.Empty:
                alone = not client.nthreads()
                if alone and not waiting:
                    log("the cluster has no worker: waiting for one")
                waiting = alone
                if cluster.kind is not None:
                    pool.scale(
                        jobs=cluster.jobs
                    )  # which asks again for those that have ended at their time limit
                yield None
                continue
            fault = future.exception()
            if task is None:
                if isinstance(fault, ImportError):
                    raise InputError(f"a worker of the cluster cannot run ifrdem: {fault}")
                for each in tasks:
                    submit(each)
            else:
                died = f"its worker died {TRIES} times (out of memory, or at the time limit of its job?)"
                message = died if isinstance(fault, distributed.KilledWorker) else repr(fault)
                yield task, message if fault is not None else future.result()
            del held[future.key]


def _jobs(cluster: ClusterSection, threads: int) -> Any:
    """A cluster whose workers are jobs of a batch system."""
    dask_jobqueue = _job_queue(cluster)
    kind = str(cluster.kind)
    if shutil.which(COMMANDS[kind]) is None:
        text = f"there is no command {COMMANDS[kind]} here: is this a login node?"
        raise InputError(f'cluster.kind = "{kind}": {text}')
    return getattr(dask_jobqueue, f"{kind.upper()}Cluster")(**_options_of_jobs(cluster, threads))


def check_jobs(cluster: ClusterSection, threads: int) -> None:
    """Raise InputError unless dask-jobqueue makes the script of a job from the options of a batch system."""
    if cluster.kind is None:
        return
    given = _options_of_jobs(cluster, threads)
    job = getattr(_job_queue(cluster), f"{cluster.kind.upper()}Cluster").job_cls
    of_job = {name for one in inspect.getmro(job)[:-1] for name in inspect.signature(one).parameters}
    own = {name: value for name, value in given.items() if name in of_job}
    try:
        job(**({"scheduler": "tcp://127.0.0.1:8786", "name": "ifrdem"} | own)).job_script()
    except Exception as error:
        # The package checks nothing by itself: whatever it raises comes from the values of these options.
        text = f"dask-jobqueue makes no job of {json.dumps(cluster.options, default=str)}: {error}"
        raise InputError(f"cluster.options: {text}") from None


def _options_of_jobs(cluster: ClusterSection, threads: int) -> dict[str, Any]:
    """Options of the cluster with those that are not given."""
    make = getattr(_job_queue(cluster), f"{str(cluster.kind).upper()}Cluster")
    classes = [*inspect.getmro(make)[:-1], *inspect.getmro(make.job_cls)[:-1]]
    known = {name for one in classes for name in inspect.signature(one).parameters} - {"args", "kwargs"}
    for name in cluster.options:
        if name not in known:
            text = (
                f"dask-jobqueue has no such option{nearest(name, known)}; it has {', '.join(sorted(known))}"
            )
            raise InputError(f"cluster.options.{name}: {text}")
    given = {"cores": 1, "processes": None, "memory": "4 GB"} | cluster.options
    for name in ("cores", "processes"):
        value = given[name]
        whole = isinstance(value, int) and not isinstance(value, bool) and value > 0
        if not whole and not (name == "processes" and value is None):
            raise InputError(
                f"cluster.options.{name} = {json.dumps(value, default=str)}: must be a whole number, 1 or more"
            )
    if not isinstance(given["memory"], str):
        value = json.dumps(given["memory"], default=str)
        raise InputError(f'cluster.options.memory = {value}: must be a text with a unit, such as "16 GB"')
    given["processes"] = given["processes"] or max(1, given["cores"] // threads)
    return given


def _job_queue(cluster: ClusterSection) -> Any:
    try:
        before = signal.getsignal(signal.SIGINT)
        import dask_jobqueue

        if threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGINT, before)  # it takes Ctrl-C as it is imported
    except ImportError:
        text = f"dask-jobqueue is not installed: {install_extra('cluster')}"
        raise InputError(f'cluster.kind = "{cluster.kind}": {text}') from None
    return dask_jobqueue
