"""Call a native FMU's functions in random order with what makes little sense, as a host gone wrong.

Started with a library, an instantiation token, the version of FMI, value references as JSON, a seed
and a number of calls; prints, as JSON, how often each function went well and how often it did not.
That an error comes without a message, or a function of the standard is missing, is an error here; a
crash is seen from outside.
"""

import ctypes
import json
import math
import random
import sys
from ctypes import byref, c_bool, c_char_p, c_double, c_int, c_size_t, c_uint32, c_void_p

ROOM = 64
ODD = (math.nan, math.inf, -math.inf, 1e300, -1e300, 5e-324, 0.0, -0.0)
BOTH = (
    ("EnterInitializationMode", "ExitInitializationMode") * 4
    + ("DoStep", "EnterContinuousTimeMode", "CompletedIntegratorStep") * 4
    + ("EnterEventMode", "Reset", "Terminate")
)
PHASES = {
    2: ("SetupExperiment", "NewDiscreteStates", "SetupExperiment"),
    3: ("EnterStepMode", "UpdateDiscreteStates"),
}
LOGGERS = {
    2: ctypes.CFUNCTYPE(None, c_void_p, c_char_p, c_int, c_char_p, c_char_p),
    3: ctypes.CFUNCTYPE(None, c_void_p, c_int, c_char_p, c_char_p),
}


class Callbacks(ctypes.Structure):
    _fields_ = (
        ("logger", LOGGERS[2]),
        ("allocate", c_void_p),
        ("free", c_void_p),
        ("finished", c_void_p),
        ("environment", c_void_p),
    )


class Host:
    def __init__(self, library, token, version, references, seed):
        self.random = random.Random(seed)
        self.library = ctypes.CDLL(library)
        self.version = version
        self.token = token.encode()
        self.references = references
        self.states_there = references.pop("states")
        self.messages = []
        logger = LOGGERS[version]
        if version == 2:
            self.logger = logger(lambda _e, _n, _s, _c, text: self.messages.append(text))
            self.callbacks = Callbacks(self.logger, None, None, None, None)
        else:
            self.logger = logger(lambda _e, _s, _c, text: self.messages.append(text))
        self.instances = []
        self.states = []
        self.counts = {}
        self.keep = None
        self.instance = c_void_p(None)

    def function(self, name):
        f = getattr(self.library, f"fmi{self.version}{name}")
        f.restype = c_int
        return f

    # -- arguments, most of them sensible --------------------------------------------------

    def number(self):
        r = self.random
        return r.choice(ODD) if r.random() < 0.02 else r.gauss(0, 1) * 10 ** r.uniform(-6, 1)

    def count(self):
        r = self.random
        return r.randrange(ROOM) if r.random() < 0.3 else r.randrange(6)

    def pointer(self, array):
        return None if self.random.random() < 0.03 else array

    def values(self):
        return self.pointer((c_double * ROOM)(*(self.number() for _ in range(ROOM))))

    def names(self, kind):
        r = self.random
        known = self.references[kind if r.random() < 0.9 else r.choice([*self.references])]
        odd = 0.1 if r.random() < 0.1 else 0.0
        chosen = [
            r.choice((r.randrange(2**32), r.randrange(200)))
            if r.random() < odd
            else r.choice(known)
            for _ in range(ROOM)
        ]
        return self.pointer((c_uint32 * ROOM)(*chosen))

    def time(self):
        r = self.random
        return c_double(r.choice((*ODD, -1.0)) if r.random() < 0.02 else r.uniform(0, 10))

    def step(self):
        r = self.random
        return c_double(r.choice((*ODD, -1.0)) if r.random() < 0.02 else 10 ** r.uniform(-5, -2))

    def state(self):
        r = self.random
        if not self.states or r.random() < 0.05:
            return c_void_p(None)
        return c_void_p(r.choice(self.states))

    # -- calls ------------------------------------------------------------------------------

    def call(self, name, *arguments):
        heard = len(self.messages)
        status = self.function(name)(self.instance, *arguments)
        one = self.counts.setdefault(name, [0, 0])
        one[status != 0] += 1
        if status not in (0, 3):
            raise SystemExit(f"{name} has status {status}")
        if status and self.instance.value and len(self.messages) == heard:
            raise SystemExit(f"{name} fails without a message")
        return status

    def instantiate(self):
        r = self.random
        name = r.choice((b"one", b"%s%n", b"", None, b"x" * 1000)) if r.random() < 0.2 else b"one"
        token = r.choice((self.token, b"{}", None)) if r.random() < 0.2 else self.token
        exchange = r.random() < 0.4
        if self.version == 2:
            make = self.library.fmi2Instantiate
            make.restype = c_void_p
            callbacks = byref(self.callbacks)
            kind = r.choice((-1, 2)) if r.random() < 0.02 else (0 if exchange else 1)
            made = make(name, kind, token, None, callbacks, 0, 1)
        else:
            kind = "ModelExchange" if exchange else "CoSimulation"
            make = getattr(self.library, f"fmi3Instantiate{kind}")
            make.restype = c_void_p
            head = (name, token, None, c_bool(False), c_bool(True))
            more, tail = (), ()
            if not exchange:
                more = (c_bool(r.random() < 0.02), c_bool(r.random() < 0.7), None, c_size_t(0))
                tail = (None,)
            made = make(*head, *more, None, self.logger, *tail)
        if made:
            self.instances.append(made)

    def free_instance(self, chosen):
        free = getattr(self.library, f"fmi{self.version}FreeInstance")
        free.restype = None
        free(c_void_p(chosen))
        self.instances.remove(chosen)
        self.states = []  # some of them were its own

    def saved(self):
        """Save, restore, free, serialize or deserialize."""
        r = self.random
        two = self.version == 2
        kind = r.randrange(5)
        state = self.state()
        if kind == 0:
            held = state if r.random() < 0.3 else c_void_p(None)
            argument = byref(held) if r.random() < 0.97 else None
            status = self.call("GetFMUstate" if two else "GetFMUState", argument)
            if not status and held.value not in self.states:
                self.states.append(held.value)
        elif kind == 1:
            self.call("SetFMUstate" if two else "SetFMUState", state)
        elif kind == 2 and (len(self.states) > 3 or r.random() < 0.05):
            before = state.value
            status = self.call("FreeFMUstate" if two else "FreeFMUState", byref(state))
            if not status and before and r.random() < 0.9:
                self.states.remove(before)  # else it is used after it is freed
        elif kind == 3:
            size = c_size_t()
            name = "SerializedFMUstateSize" if two else "SerializedFMUStateSize"
            if self.call(name, state, byref(size)):
                return
            room = (ctypes.c_char * size.value)()
            given = c_size_t(size.value if r.random() < 0.8 else r.randrange(size.value))
            name = "SerializeFMUstate" if two else "SerializeFMUState"
            if not self.call(name, state, self.pointer(room), given):
                self.keep = room
        elif kind == 4 and self.keep is not None:
            data = bytearray(self.keep)
            if r.random() < 0.5:
                data[r.randrange(len(data))] ^= 1 << r.randrange(8)
            room = (ctypes.c_char * len(data)).from_buffer(data)
            new = c_void_p(None)
            name = "DeSerializeFMUstate" if two else "DeserializeFMUState"
            size = c_size_t(len(data) if r.random() < 0.8 else r.randrange(len(data)))
            if not self.call(name, self.pointer(room), size, byref(new)):
                self.states.append(new.value)

    def phase(self):
        name = self.random.choice(BOTH + PHASES[self.version])
        flags = (ctypes.c_byte * ROOM)()
        doubles = (c_double * 2)()
        three = self.version == 3
        if name == "SetupExperiment":
            one = int(self.random.random() < 0.5)
            self.call(name, one, c_double(1e-6), self.time(), 0, c_double(0))
        elif name == "EnterInitializationMode" and three:
            one = c_bool(self.random.random() < 0.5)
            self.call(name, one, c_double(1e-6), self.time(), c_bool(False), c_double(0))
        elif name == "DoStep" and three:
            pointers = [self.pointer(byref(flags, k)) for k in range(3)]
            last = self.pointer(byref(doubles))
            self.call(name, self.time(), self.step(), c_bool(True), *pointers, last)
        elif name == "DoStep":
            self.call(name, self.time(), self.step(), 1)
        elif name == "NewDiscreteStates":
            self.call(name, self.pointer(flags))
        elif name == "UpdateDiscreteStates":
            pointers = [self.pointer(byref(flags, k)) for k in range(5)]
            self.call(name, *pointers, self.pointer(byref(doubles)))
        elif name == "CompletedIntegratorStep":
            ends = [self.pointer(byref(flags, 4 * k)) for k in range(2)]
            self.call(name, c_bool(True) if three else 1, *ends)
        else:
            self.call(name)

    def signals(self):
        r = self.random
        n = c_size_t(self.count())
        kind = r.choice(("Get", "Set"))
        more = ()
        if self.version == 2:
            name = r.choice(("Real", "Real", "Real", "Real", "Integer", "Boolean", "String"))
        else:
            name = r.choice(("Float64",) * 5 + ("Int32", "Boolean", "String", "Float32", "Clock"))
            if name != "Clock":
                more = (n if r.random() < 0.95 else c_size_t(self.count()),)
        if name == "String" and kind == "Set":
            return
        names = self.names("inputs" if kind == "Set" else "outputs")
        self.call(kind + name, names, n, self.values(), *more)

    def continuous(self):
        n = c_size_t(self.random.choice((self.count(), self.states_there, self.states_there)))
        names = {
            2: "GetDerivatives GetContinuousStates SetContinuousStates GetEventIndicators "
            "GetNominalsOfContinuousStates",
            3: "GetContinuousStateDerivatives GetContinuousStates SetContinuousStates "
            "GetEventIndicators GetNominalsOfContinuousStates",
        }
        self.call(self.random.choice(names[self.version].split()), self.values(), n)
        if self.random.random() < 0.3:
            self.call("SetTime", self.time())

    def derivatives(self):
        n, m = c_size_t(self.count()), c_size_t(self.count())
        head = (self.names("outputs"), n, self.names("inputs"), m)
        if self.version == 2:
            self.call("GetDirectionalDerivative", *head, self.values(), self.values())
            return
        wrong = self.random.random() < 0.05
        sizes = (n, m) if wrong else (m, n)
        self.call(
            "GetDirectionalDerivative", *head, self.values(), sizes[0], self.values(), sizes[1]
        )
        self.call("GetAdjointDerivative", *head, self.values(), sizes[1], self.values(), sizes[0])

    def run(self, calls):
        r = self.random
        kinds = [self.phase] * 6 + [self.signals] * 5 + [self.saved] * 3
        kinds += [self.continuous, self.continuous, self.derivatives]
        while sum(map(sum, self.counts.values())) < calls:
            if not self.instances or (len(self.instances) < 3 and r.random() < 0.01):
                self.instantiate()
                continue
            if r.random() < 0.001:
                self.free_instance(r.choice(self.instances))
                continue
            self.instance = c_void_p(r.choice(self.instances) if r.random() < 0.99 else None)
            r.choice(kinds)()
            if len(self.messages) > 1000:
                del self.messages[:]
        while self.instances:
            self.free_instance(self.instances[-1])
        print(json.dumps(self.counts))


library, token, version, references, seed, calls = sys.argv[1:]
Host(library, token, int(version), json.loads(references), int(seed)).run(int(calls))
