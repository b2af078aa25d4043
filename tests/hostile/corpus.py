"""Hostile plugins, with the outcome of each and a phrase of its message."""

from dataclasses import dataclass
from textwrap import dedent, indent

SLEEPER = "4321.25"  # an argument that tells processes of this corpus

HEADER = """
import asyncio, atexit, builtins, contextlib, ctypes, datetime, gc, importlib, io, locale, mmap
import multiprocessing, os, pickle, resource, signal, socket, stat, struct, subprocess, sys
import tempfile, threading, time, warnings
from pathlib import Path
from types import SimpleNamespace
import numpy as np

def good(**more):
    return SimpleNamespace(**({"weights": np.ones((2, 4))} | more))

SLEEP = [sys.executable, "-c", "import time; time.sleep(4321.25)", "4321.25"]

def own_socket():
    for number in range(3, 100):
        with contextlib.suppress(OSError):
            if stat.S_ISSOCK(os.fstat(number).st_mode):
                return socket.socket(fileno=os.dup(number))

def say(content):
    own_socket().setblocking(True)
    own_socket().sendall(content)
"""


@dataclass(frozen=True)
class Hostile:
    """One estimator.

    Attributes:
        name: name of its class.
        status: status of its trial; ``refused`` if the run does not start with it.
        phrase: part of the message.
        work: body of ``estimate``; a good estimate follows it.
        members: other members of the class.
        module: code of its module, which is then a separate file.
        beside: names and contents of files beside this file.
    """

    name: str
    status: str
    phrase: str
    work: str = ""
    members: str = ""
    module: str = ""
    beside: tuple[tuple[str, str], ...] = ()

    @property
    def alone(self) -> bool:
        """Whether it has a separate file."""
        return bool(self.module or self.beside)

    def code(self) -> str:
        """The code of its class."""
        work = indent(dedent(self.work).strip(), " " * 8)
        members = indent(dedent(self.members).strip(), " " * 4)
        return (
            f"\n{dedent(self.module)}\nclass {self.name}:\n    name = {self.name!r}\n{members}\n"
            "    def estimate(self, problem, observation, *, rng, budget):\n"
            f"{work}\n        return good()\n"
        )


def _one_line(name: str, status: str, phrase: str, work: str) -> Hostile:
    return Hostile(name, status, phrase, work)


CRASHES = [
    Hostile("Segfaults", "crash", "SIGSEGV", "ctypes.string_at(0)"),
    Hostile("Aborts", "crash", "SIGABRT", "os.abort()"),
    Hostile("EndsWithSeven", "crash", "exit code 7", "os._exit(7)"),
    Hostile("EndsWell", "crash", "exit code 0", "os._exit(0)"),
    Hostile("KillsItself", "crash", "SIGKILL", "os.kill(os.getpid(), signal.SIGKILL)"),
    Hostile("EndsByTerm", "crash", "SIGTERM", "os.kill(os.getpid(), signal.SIGTERM)"),
    Hostile("Traps", "crash", "SIGFPE", "os.kill(os.getpid(), signal.SIGFPE)"),
    Hostile("KillsItsParent", "crash", "PermissionError", "os.kill(os.getppid(), signal.SIGKILL)"),
    Hostile(
        "KillsTheDriver",
        "crash",
        "PermissionError",
        """
        above = int(Path(f"/proc/{os.getppid()}/stat").read_text().rpartition(")")[2].split()[1])
        os.kill(above, signal.SIGKILL)
        """,
    ),
    Hostile("StopsItsParent", "crash", "PermissionError", "os.kill(os.getppid(), signal.SIGSTOP)"),
    Hostile(
        "KillsGroupOfParent",
        "crash",
        "PermissionError",
        "os.killpg(os.getpgid(os.getppid()), signal.SIGTERM)",
    ),
    Hostile("Recurses", "crash", "RecursionError", "def f(): f()\nf()"),
    Hostile(
        "OverflowsItsStack",
        "crash",
        "SIGSEGV",
        """
        sys.setrecursionlimit(10**9)
        @property
        def again(self): return repr(self)
        class Deep:
            def __repr__(self): return "%r" % (self,)
        ctypes.memset(ctypes.c_void_p(8), 0, 10)
        repr(Deep())
        """,
    ),
    Hostile("Exits", "crash", "SystemExit: done", "sys.exit('done')"),
    Hostile("ExitsWithAnObject", "crash", "SystemExit", "raise SystemExit(object())"),
    Hostile(
        "DiesWithAChild", "crash", "exit code 9", "if os.fork(): os._exit(9)\ntime.sleep(4321.25)"
    ),
    Hostile("CorruptsItsHeap", "crash", "SIG", "ctypes.memset(id(None), 255, 64)\nos.abort()"),
]

HANGS = [
    Hostile("Sleeps", "timeout", "of estimate", "time.sleep(4321.25)"),
    Hostile("BusyLoops", "timeout", "of estimate", "while True: pass"),
    Hostile("HoldsTheLock", "timeout", "of estimate", "ctypes.PyDLL(None).sleep(4321)"),
    Hostile(
        "BlocksSignals",
        "timeout",
        "of estimate",
        """
        signal.pthread_sigmask(signal.SIG_BLOCK, set(signal.Signals))
        for number in set(signal.Signals) - {signal.SIGKILL, signal.SIGSTOP}:
            with contextlib.suppress(OSError, ValueError):
                signal.signal(number, signal.SIG_IGN)
        time.sleep(4321.25)
        """,
    ),
    Hostile("StopsItself", "timeout", "of estimate", "os.kill(os.getpid(), signal.SIGSTOP)"),
    Hostile(
        "HangsInSupports",
        "timeout",
        "of set-up",
        members="def supports(self, problem): time.sleep(4321.25)",
    ),
    Hostile(
        "HangsInWarmUp",
        "timeout",
        "of set-up",
        members="def warm_up(self, problem): time.sleep(4321.25)",
    ),
    Hostile(
        "HangsInDel",
        "timeout",
        "of estimate",
        """
        class Late:
            def __del__(self): time.sleep(4321.25)
        late = Late()
        del late
        """,
    ),
    Hostile(
        "HangsInAProperty",
        "timeout",
        "of estimate",
        """
        class Slow:
            @property
            def weights(self): time.sleep(4321.25)
        return Slow()
        """,
    ),
    Hostile(
        "HangsInArray",
        "timeout",
        "of estimate",
        """
        class Slow:
            def __array__(self, *args, **kwargs): time.sleep(4321.25)
        return good(weights=Slow())
        """,
    ),
    Hostile(
        "Deadlocks",
        "timeout",
        "of estimate",
        "lock = threading.Lock()\nlock.acquire()\nlock.acquire()",
    ),
    Hostile("WaitsForInput", "crash", "EOFError", "input()"),
    Hostile(
        "ClosesEverything",
        "crash",
        "closed its connection",
        "os.closerange(0, 100)\ntime.sleep(4321.25)",
    ),
    Hostile(
        "HangsAtLaterImport",
        "timeout",
        "of set-up",
        module="if resource.getrlimit(resource.RLIMIT_DATA)[0] < 2**31: time.sleep(4321.25)",
    ),
]

MEMORY = [
    Hostile(
        "Hoards", "crash", "out of memory", "kept = []\nwhile True: kept.append(np.ones(2**22))"
    ),
    Hostile(
        "HoardsSharedMemory",
        "crash",
        "PermissionError",
        """
        kept = []
        while True:
            kept.append(mmap.mmap(-1, 2**24))
            kept[-1].write(b"x" * 2**24)
            time.sleep(0.01)
        """,
    ),
    Hostile(
        "HoardsInAMemfd",
        "crash",
        "PermissionError",
        """
        file = os.memfd_create("hoard")
        while True:
            os.write(file, b"x" * 2**24)
            time.sleep(0.01)
        """,
    ),
    Hostile(
        "HoardsInSeveralMemfds",
        "crash",
        "PermissionError",
        """
        files = []
        while True:
            files.append(os.memfd_create("hoard"))
            os.write(files[-1], b"x" * 2**24)
            time.sleep(0.01)
        """,
    ),
    Hostile(
        "HoardsInShm",
        "crash",
        "",
        """
        with tempfile.NamedTemporaryFile(dir="/dev/shm") as file:
            while True:
                os.write(file.fileno(), b"x" * 2**24)
                time.sleep(0.01)
        """,
    ),
    Hostile(
        "HoardsInChildren",
        "crash",
        "out of memory",
        """
        for k in range(8):
            if not os.fork():
                kept = np.ones(2**25)
                time.sleep(4321.25)
        time.sleep(4321.25)
        """,
    ),
    Hostile(
        "HoardsAtImport",
        "crash",
        "MemoryError",
        module="""
        if resource.getrlimit(resource.RLIMIT_DATA)[0] < 2**31:
            kept = []
            while True: kept.append(np.ones(2**22))
        """,
    ),
    Hostile("AsksForEverything", "crash", "", "np.ones(10**12)"),
    Hostile(
        "LiftsItsLimit",
        "crash",
        "",
        "resource.setrlimit(resource.RLIMIT_DATA, (2**40, 2**40))\nwhile True: time.sleep(1)",
    ),
]

OUTPUT = [
    Hostile("LongMessage", "ok", "...", "return good(message='m' * 30_000_000)"),
    Hostile("LongException", "crash", "...", "raise ValueError('m' * 30_000_000)"),
    Hostile(
        "PrintsForEver",
        "timeout",
        "of estimate",
        "while True:\n    print('x' * 1000)\n    time.sleep(0.01)",
    ),
    Hostile("PrintsBytes", "ok", "", "os.write(1, bytes(range(256)) * 10)"),
    Hostile("ClosesItsOutput", "ok", "", "os.close(1)\nos.close(2)\nprint('nobody hears')"),
    Hostile("MessageIsNoText", "ok", r"\udc80\x00a b", "return good(message='\\udc80\\x00a\\nb')"),
    Hostile("MessageIsBytes", "ok", "", "return good(message=b'\\xff\\xfe')"),
    Hostile("ManyExtras", "ok", "", "return good(extras={f'n{k}': k for k in range(10**5)})"),
    Hostile("LongExtra", "ok", "", "return good(extras={'x' * 10**6: 1.0, 'y': 'z' * 10**6})"),
    Hostile("Formula", "ok", "=HYPERLINK", "return good(message='=HYPERLINK(\"http://x\")')"),
]

RETURNED = [
    Hostile("Nothing", "invalid", "NoneType", "return None"),
    Hostile("WrongShape", "invalid", "shape (3, 4)", "return good(weights=np.ones((3, 4)))"),
    Hostile("NotANumber", "invalid", "not finite", "return good(weights=np.full((2, 4), np.nan))"),
    Hostile("Infinite", "invalid", "not finite", "return good(weights=np.full((2, 4), np.inf))"),
    Hostile("Negative", "invalid", "negative", "return good(weights=-np.ones((2, 4)))"),
    Hostile("AllZero", "invalid", "all zero", "return good(weights=np.zeros((2, 4)))"),
    Hostile("Complex", "invalid", "not an array", "return good(weights=np.ones((2, 4)) * 1j)"),
    Hostile("Strings", "invalid", "not an array", "return good(weights=[['1'] * 4] * 2)"),
    Hostile(
        "Dates",
        "invalid",
        "not an array",
        "return good(weights=np.full((2, 4), np.datetime64('2026-01-01')))",
    ),
    Hostile("Text", "invalid", "not an array", "return good(weights='heavy')"),
    Hostile("AClass", "invalid", "", "return good(weights=int)"),
    Hostile("Recursive", "invalid", "not an array", "w = []\nw.append(w)\nreturn good(weights=w)"),
    Hostile(
        "TooDeep", "invalid", "", "w = []\nfor k in range(10**5): w = [w]\nreturn good(weights=w)"
    ),
    Hostile(
        "Raises",
        "invalid",
        "ZeroDivisionError",
        """
        class Lazy:
            @property
            def weights(self): return 1 / 0
        return Lazy()
        """,
    ),
    Hostile(
        "RaisesBase",
        "crash",
        "KeyboardInterrupt",
        """
        class Lazy:
            @property
            def weights(self): raise KeyboardInterrupt
        return Lazy()
        """,
    ),
    Hostile(
        "LazySequence",
        "invalid",
        "not an array",
        """
        class Endless:
            def __len__(self): return 10**9
            def __getitem__(self, index): return 1.0
        return good(weights=Endless())
        """,
    ),
    Hostile(
        "LiesAboutItsLength",
        "invalid",
        "",
        """
        class Liar:
            def __len__(self): return -1
            def __getitem__(self, index): raise IndexError
        return good(weights=Liar())
        """,
    ),
    Hostile(
        "PromisesAHugeArray",
        "invalid",
        "Unable to allocate",
        "return good(states=np.lib.stride_tricks.as_strided(np.ones(1), (10**9, 2, 4), (0, 0, 0)))",
    ),
    Hostile("SendsTooMuch", "invalid", "at most", "return good(states=np.ones((2**20, 2, 8)))"),
    Hostile(
        "NotPsd", "invalid", "not positive semi-definite", "return good(covariance=-np.eye(8))"
    ),
    Hostile(
        "CovarianceOfNaN", "invalid", "not finite", "return good(covariance=np.eye(8) * np.nan)"
    ),
    Hostile(
        "CovarianceOfOnePlayer",
        "invalid",
        "covariance has the shape (4, 4)",
        "return good(covariance=np.eye(4))",
    ),
    Hostile("OddRegion", "invalid", "region is 'ellipse'", "return good(region='ellipse')"),
    Hostile(
        "RegionOfNothing",
        "invalid",
        "there is no samples",
        "return good(covariance=np.eye(8), region='samples')",
    ),
    Hostile(
        "FewSamples",
        "invalid",
        "there are 39 samples, expected 40",
        "return good(samples=np.ones((39, 2, 4)))",
    ),
    Hostile(
        "SamplesOfNaN",
        "invalid",
        "samples are not finite",
        "return good(samples=np.full((40, 2, 4), np.nan))",
    ),
    Hostile(
        "FlatSamples",
        "invalid",
        "samples have the shape (40, 8)",
        "return good(samples=np.ones((40, 8)))",
    ),
    Hostile(
        "ObjectArray", "invalid", "not an array", "return good(weights=np.full((2, 4), object()))"
    ),
    Hostile("ConvergedIsText", "invalid", "converged", "return good(converged='no')"),
    Hostile("MessageIsANumber", "invalid", "message is 3", "return good(message=3)"),
    Hostile("ExtrasAreAList", "invalid", "extras are", "return good(extras=[1])"),
    Hostile(
        "ObjectiveTooLarge", "invalid", "objective", "return good(extras={'objective': 10**400})"
    ),
    Hostile("HugeInteger", "ok", "", "return good(extras={'n': 10**5000})"),
    Hostile(
        "StatesOfOneStep",
        "invalid",
        "states have the shape",
        "return good(states=np.zeros((1, 2, 4)))",
    ),
    Hostile("Mutates", "crash", "read-only", "observation.y[0] = 0"),
    Hostile("GivesUp", "not_converged", "lost", "return good(converged=False, message='lost')"),
    Hostile("Declines", "skipped", "never", members="def supports(self, problem): return 'never'"),
    Hostile(
        "DeclinesOddly",
        "crash",
        "",
        members="""
        def supports(self, problem):
            class Odd:
                def __bool__(self): raise ValueError("neither")
            return Odd()
        """,
    ),
]

EXCEPTIONS = [
    Hostile("Errs", "crash", "RuntimeError: no idea", "raise RuntimeError('no\\nidea')"),
    Hostile(
        "OwnUserError",
        "crash",
        "mine",
        "from olne_bench.errors import UserError\nraise UserError('mine')",
    ),
    Hostile(
        "OwnPluginError",
        "crash",
        "mine",
        "from olne_bench.plugins import PluginError\nraise PluginError('mine')",
    ),
    Hostile(
        "OwnInvalidEstimateError",
        "crash",
        "mine",
        """
        from olne_bench.bench.judge.raw_estimate import InvalidEstimateError
        raise InvalidEstimateError("mine")
        """,
    ),
    Hostile(
        "OwnStartError",
        "crash",
        "mine",
        "from olne_bench.bench.process.child import StartError\nraise StartError('mine')",
    ),
    Hostile(
        "OwnChildError",
        "crash",
        "mine",
        "from olne_bench.bench.process.child import ChildError\nraise ChildError('mine')",
    ),
    Hostile(
        "OwnNoEquilibriumError",
        "crash",
        "mine",
        "from olne_bench.envs.recordings.recording import NoEquilibriumError as E\nraise E('mine')",
    ),
    Hostile("Interrupts", "crash", "KeyboardInterrupt", "raise KeyboardInterrupt"),
    Hostile("Leaves", "crash", "GeneratorExit: early", "raise GeneratorExit('early')"),
    Hostile("ErrsOutOfMemory", "crash", "out of memory", "raise MemoryError"),
    Hostile("EndsIteration", "crash", "StopIteration", "raise StopIteration"),
    Hostile(
        "HasNoText",
        "crash",
        "Mute: no text",
        """
        class Mute(Exception):
            def __str__(self): raise ValueError
        raise Mute
        """,
    ),
    Hostile(
        "TextEndsTheProcess",
        "crash",
        "exit code 3",
        """
        class Ends(Exception):
            def __str__(self): os._exit(3)
        raise Ends
        """,
    ),
    Hostile(
        "TextNeverEnds",
        "timeout",
        "of estimate",
        """
        class Endless(Exception):
            def __str__(self): time.sleep(4321.25)
        raise Endless
        """,
    ),
    Hostile(
        "MetaclassRaises",
        "crash",
        "",
        """
        class Meta(type):
            def __getattribute__(cls, name): raise ValueError(name)
        class Hidden(Exception, metaclass=Meta): pass
        raise Hidden
        """,
    ),
    Hostile(
        "RaisesAGroup",
        "crash",
        "ExceptionGroup",
        "raise BaseExceptionGroup('many', [KeyboardInterrupt(), SystemExit(1)])",
    ),
    Hostile(
        "CausesForEver",
        "crash",
        "ValueError",
        "a, b = ValueError(1), ValueError(2)\na.__cause__, b.__cause__ = b, a\nraise a",
    ),
]

PROCESSES = [
    Hostile(
        "LeavesAProcess",
        "invalid",
        "left processes running",
        "subprocess.Popen(SLEEP)",
    ),
    Hostile(
        "LeavesASession",
        "invalid",
        "left processes running",
        "subprocess.Popen(SLEEP, start_new_session=True)",
    ),
    Hostile(
        "ForksTwice",
        "invalid",
        "left processes running",
        """
        if not os.fork():
            os.setsid()
            if not os.fork():
                time.sleep(4321.25)
            os._exit(0)
        os.wait()
        """,
    ),
    Hostile(
        "Nohup",
        "invalid",
        "left processes running",
        "subprocess.run([sys.executable, '-c', f'import subprocess; subprocess.Popen({SLEEP!r})'])",
    ),
    Hostile(
        "LeavesADaemonThread",
        "ok",
        "",
        "threading.Thread(target=time.sleep, args=(4321.25,), daemon=True).start()",
    ),
    Hostile(
        "LeavesAThread", "ok", "", "threading.Thread(target=time.sleep, args=(4321.25,)).start()"
    ),
    Hostile("TimeBomb", "ok", "", "threading.Timer(0.5, os._exit, [5]).start()"),
    Hostile("RegistersAtExit", "ok", "", "atexit.register(time.sleep, 4321.25)"),
    Hostile("ForkComesBackTwice", "invalid", "", "os.fork()"),
    Hostile("RunsAProgram", "crash", "PermissionError", "subprocess.run(['sh', '-c', 'true'])"),
    Hostile("LeavesItsGroup", "crash", "PermissionError", "os.setsid()"),
    Hostile(
        "IsNoReaper",
        "ok",
        "",
        """
        ctypes.CDLL(None).prctl(36, 0, 0, 0, 0)
        apart = f"import subprocess; subprocess.Popen({SLEEP!r}, start_new_session=True)"
        subprocess.run([sys.executable, "-c", apart])
        time.sleep(0.3)
        """,
    ),
    Hostile(
        "ForksAndDies",
        "crash",
        "exit code 4",
        """
        for k in range(10):
            if not os.fork():
                os.setsid()
                time.sleep(4321.25)
        os._exit(4)
        """,
    ),
    Hostile(
        "SurvivesItsParent",
        "invalid",
        "left processes running",
        """
        if not os.fork():
            ctypes.CDLL(None).prctl(1, 0, 0, 0, 0)
            os.setsid()
            for number in set(signal.Signals) - {signal.SIGKILL, signal.SIGSTOP}:
                with contextlib.suppress(OSError, ValueError):
                    signal.signal(number, signal.SIG_IGN)
            time.sleep(4321.25)
        """,
    ),
    Hostile(
        "LeavesAResourceTracker",
        "crash",
        "PermissionError",
        """
        from multiprocessing import shared_memory
        shared_memory.SharedMemory(create=True, size=10).unlink()
        """,
    ),
]

MESSAGES = [
    Hostile(
        "SendsHalfAMessage", "timeout", "", "say(b'\\x00\\x00\\x01\\x00abc')\ntime.sleep(4321.25)"
    ),
    Hostile("SendsHalfAndAnswers", "invalid", "", "say(b'\\x00\\x00\\x00\\x05abc')"),
    Hostile("SendsGarbage", "invalid", "", "say(b'\\x00\\x00\\x00\\x05hello')\ntime.sleep(1)"),
    Hostile("AnnouncesTooMuch", "invalid", "at most", "say(b'\\xff' * 100)\ntime.sleep(1)"),
    Hostile(
        "ForgesAResult",
        "invalid",
        "unexpected message",
        """
        from olne_bench.bench.process.messages import Result, encode
        import msgspec
        body = encode(Result(1, msgspec.Raw(encode({"estimate": None}))))
        say(struct.pack("!I", len(body)) + body)
        time.sleep(1)
        """,
    ),
    Hostile(
        "ForgesAStage",
        "invalid",
        "unexpected message",
        """
        from olne_bench.bench.process.messages import Stage, encode
        body = encode(Stage("estimate", 1e6))
        say(struct.pack("!I", len(body)) + body)
        time.sleep(1)
        """,
    ),
    Hostile(
        "SaysReadyAgain",
        "invalid",
        "unexpected message",
        """
        from olne_bench.bench.process.messages import Ready, encode
        body = encode(Ready())
        say(struct.pack("!I", len(body)) + body)
        time.sleep(1)
        """,
    ),
    Hostile(
        "SendsAPickle",
        "invalid",
        "not a message",
        """
        class Evil:
            def __reduce__(self): return os._exit, (99,)
        body = pickle.dumps(Evil())
        say(struct.pack("!I", len(body)) + body)
        time.sleep(1)
        """,
    ),
    Hostile(
        "AnswersTwice",
        "invalid",
        "forged",
        """
        from olne_bench.bench.process.messages import Result, encode
        import msgspec
        frame = sys._getframe()
        while "token" not in frame.f_locals:
            frame = frame.f_back
        answer = msgspec.Raw(encode({"estimate": None, "malformed": "forged"}))
        body = encode(Result(frame.f_locals["token"], answer))
        say(struct.pack("!I", len(body)) + body)
        """,
    ),
    Hostile(
        "ClosesTheSocket",
        "crash",
        "",
        "own_socket().shutdown(socket.SHUT_RDWR)\ntime.sleep(4321.25)",
    ),
    Hostile(
        "ReadsTheSocket",
        "timeout",
        "",
        "s = own_socket()\ns.setblocking(True)\ns.recv(100)\ntime.sleep(4321.25)",
    ),
    Hostile(
        "ForgesItsOwnAnswer",
        "invalid",
        "malformed",
        """
        from olne_bench.bench.run import player
        player.read_estimate = lambda result: {"weights": [1.0]}
        """,
    ),
    Hostile(
        "ForgesInfinity",
        "invalid",
        "",
        """
        from olne_bench.bench.run import player
        from olne_bench.bench.judge.raw_estimate import RawEstimate
        from olne_bench.bench.process.messages import Array
        weights = Array((2, 4), np.full(8, np.nan).tobytes())
        raw = RawEstimate(weights, None, None, None, None, True, "", None, {})
        player.read_estimate = lambda result: raw
        """,
    ),
    Hostile(
        "ForgesAShape",
        "invalid",
        "",
        """
        from olne_bench.bench.run import player
        from olne_bench.bench.judge.raw_estimate import RawEstimate
        from olne_bench.bench.process.messages import Array
        raw = RawEstimate(Array((-1, 4), b"abc"), None, None, None, None, True, "", None, {})
        player.read_estimate = lambda result: raw
        """,
    ),
    Hostile(
        "ForgesLongTexts",
        "ok",
        "...",
        """
        from olne_bench.bench.run import player
        from olne_bench.bench.judge.raw_estimate import RawEstimate
        from olne_bench.bench.process.messages import pack
        raw = RawEstimate(pack(np.ones((2, 4))), *[None] * 4, True, "m" * 10**7, None, {})
        player.read_estimate = lambda result: raw
        """,
    ),
]

STATE = [
    Hostile(
        "ChangesEverything",
        "ok",
        "",
        """
        os.environ["OMP_NUM_THREADS"] = "7"
        os.environ["CC"] = "no-such-compiler"
        sys.path[:] = ["/nowhere"]
        np.linalg.norm = lambda *args, **kwargs: 1.0
        np.linalg.solve = np.linalg.eigvalsh = None
        np.random.seed(1)
        np.random.default_rng = None
        np.seterr(all="raise")
        warnings.simplefilter("error")
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        locale.setlocale(locale.LC_ALL, "C")
        time.time = lambda: 0.0
        """,
    ),
    Hostile("ChangesItsFolder", "ok", "", "os.chdir('/')"),
    Hostile(
        "ChangesBuiltins",
        "crash",
        "the process died with exit code 1",
        "builtins.len = lambda thing: 0\nbuiltins.sum = None\nbuiltins.getattr = None",
    ),
    Hostile(
        "ChangesOurFunctions",
        "ok",
        "",
        """
        from olne_bench.bench import text
        from olne_bench.bench.judge import raw_estimate
        from olne_bench.bench.process import messages
        from olne_bench.games.model import observation
        text.clip = raw_estimate.is_plain_number = messages.unpack = None
        observation.FullView.sense = lambda *args: 0.0
        """,
    ),
    Hostile("EmptiesModules", "ok", "", "sys.modules.clear()"),
    Hostile(
        "ChangesTheProblem",
        "invalid",
        "it changes the problem: ",
        "object.__setattr__(problem.game, 'dt', 5.0)\nobject.__setattr__(problem, 'sigma', 0.0)",
    ),
    Hostile(
        "WritesALogBesideItself",
        "crash",
        "PermissionError",
        "Path(__file__).with_suffix('.log').write_text('x')",
    ),
    Hostile("WritesIntoItsFolder", "ok", "", "Path('own.log').write_text('x')"),
    Hostile("DeletesItsSource", "crash", "PermissionError", "Path(__file__).unlink()"),
    Hostile(
        "OverwritesItsNeighbour",
        "crash",
        "PermissionError",
        "(Path(__file__).parent / 'neighbour.py').write_text('raise SystemExit')",
    ),
    Hostile(
        "WritesIntoTheCache",
        "crash",
        "PermissionError",
        """
        from olne_bench.games.compiled import compiler
        Path(compiler.__file__).with_name("x.pyc").write_bytes(b"x")
        """,
    ),
    Hostile(
        "WritesIntoTheStore",
        "crash",
        "PermissionError",
        """
        (Path(__file__).parents[1] / "run" / "out" / "x").write_text("x")
        """,
    ),
    Hostile(
        "MakesLinks",
        "crash",
        "PermissionError",
        "os.symlink('/etc/passwd', Path(__file__).with_name('link'))",
    ),
    Hostile(
        "PatchesAtImport",
        "ok",
        "",
        module="""
        import olne_bench.games.solve.newton as newton
        import olne_bench.bench.run.player as player
        newton.newton_root = None
        np.linalg.solve = None
        sys.dont_write_bytecode = False
        sys.path.insert(0, os.path.dirname(__file__))
        os.environ["PYTHONHASHSEED"] = "random"
        """,
    ),
    Hostile(
        "Profiles", "ok", "", "sys.setprofile(lambda *args: None)\nsys.settrace(lambda *args: None)"
    ),
    Hostile("SwitchesOffCollection", "ok", "", "gc.disable()\nsys.setswitchinterval(1e-9)"),
]

IMPORTS = [
    Hostile(
        "FailsToImport", "refused", "RuntimeError: at once", module="raise RuntimeError('at once')"
    ),
    Hostile("ExitsAtImport", "refused", "SystemExit", module="sys.exit('bye')"),
    Hostile("EndsAtImport", "refused", "exit code 6", module="os._exit(6)"),
    Hostile("NoSyntax", "refused", "SyntaxError", module="def f(:"),
    Hostile(
        "FailsItsLaterImport",
        "crash",
        "RuntimeError: later",
        module="""
        if resource.getrlimit(resource.RLIMIT_DATA)[0] < 2**31: raise RuntimeError("later")
        """,
    ),
    Hostile(
        "ExitsAtItsLaterImport",
        "crash",
        "SystemExit",
        module="""
        if resource.getrlimit(resource.RLIMIT_DATA)[0] < 2**31: sys.exit("later")
        """,
    ),
    Hostile(
        "RaisesOursAtItsLaterImport",
        "crash",
        "mine",
        module="""
        from olne_bench.bench.process.child import StartError
        if resource.getrlimit(resource.RLIMIT_DATA)[0] < 2**31: raise StartError("mine")
        """,
    ),
    Hostile(
        "NeedsAHelper",
        "ok",
        "first helper",
        "import hostile_helper\nreturn good(message=hostile_helper.TEXT)",
        module="import hostile_helper",
        beside=(("hostile_helper.py", "TEXT = 'first helper'"),),
    ),
    Hostile(
        "NeedsAnotherHelper",
        "ok",
        "second helper",
        "import hostile_helper\nreturn good(message=hostile_helper.TEXT)",
        module="import hostile_helper",
        beside=(("hostile_helper.py", "TEXT = 'second helper'"),),
    ),
    Hostile(
        "ShadowsModules",
        "ok",
        "",
        "import json, numpy\nassert json.dumps(1) == '1' and numpy.ones",
        beside=(
            ("json.py", "raise RuntimeError('shadow')"),
            ("numpy.py", "raise RuntimeError('shadow')"),
            ("msgspec.py", "raise RuntimeError('shadow')"),
            ("games.py", "raise RuntimeError('shadow')"),
        ),
    ),
    Hostile(
        "OddMetaclass",
        "refused",
        "",
        module="""
        class Meta(type):
            def __getattribute__(cls, name): raise ValueError(name)
            def __call__(cls, *args): raise SystemExit(name)
        class Odd(metaclass=Meta):
            name = "Odd"
            def estimate(self): pass
        """,
    ),
    Hostile(
        "OddModule",
        "ok",
        "",
        module="""
        def __getattr__(name): raise KeyboardInterrupt(name)
        """,
        members="def __class_getitem__(cls, item): raise SystemExit",
    ),
    Hostile(
        "RaisesInInit",
        "refused",
        "cannot be made",
        members="def __init__(self): raise KeyboardInterrupt",
        module="x = 1",
    ),
    Hostile("HasNoName", "refused", "name", module="x = 1", members="name = None"),
    Hostile("NameOfTwoLines", "refused", "name", module="x = 1", members="name = 'a\\nb'"),
    Hostile(
        "NameIsAProperty",
        "refused",
        "name",
        module="x = 1",
        members="@property\ndef name(self): os._exit(3)",
    ),
]
