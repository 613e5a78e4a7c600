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
from ctypes import byref, c_bool, c_byte, c_char_p, c_double, c_int, c_size_t, c_uint32, c_void_p

ROOM = 64
ODD = (math.nan, math.inf, -math.inf, 1e300, -1e300, 5e-324, 0.0, -0.0)
# How often each function is called, and its arguments: t time, h step, x 1e-6, b a truth value,
# n and m two counts, s the number of states, o and i references of outputs and inputs, d numbers,
# f flags. FMI 3.0 gives the number of values once more.
BOTH = {
    "ExitInitializationMode": (24, ""),
    "EnterContinuousTimeMode": (24, ""),
    "CompletedIntegratorStep": (24, "bff"),
    "EnterEventMode": (6, ""),
    "Reset": (6, ""),
    "Terminate": (6, ""),
    "GetBoolean": (9, "ond"),
    "SetBoolean": (9, "ind"),
    "GetString": (9, "ond"),
    "GetContinuousStates": (10, "ds"),
    "SetContinuousStates": (10, "ds"),
    "GetEventIndicators": (10, "ds"),
    "GetNominalsOfContinuousStates": (10, "ds"),
    "SetTime": (16, "t"),
}
CALLS = {
    2: BOTH
    | {
        "SetupExperiment": (12, "bxtbx"),
        "EnterInitializationMode": (24, ""),
        "DoStep": (24, "thb"),
        "NewDiscreteStates": (6, "f"),
        "GetReal": (37, "ond"),
        "SetReal": (37, "ind"),
        "GetInteger": (9, "ond"),
        "SetInteger": (9, "ind"),
        "GetDerivatives": (10, "ds"),
        "GetDirectionalDerivative": (26, "onimdd"),
    },
    3: {name: (w, a + "n" if a in ("ond", "ind") else a) for name, (w, a) in BOTH.items()}
    | {
        "EnterInitializationMode": (24, "bxtbx"),
        "DoStep": (24, "thbffff"),
        "EnterStepMode": (6, ""),
        "UpdateDiscreteStates": (6, "ffffff"),
        "GetFloat64": (37, "ondn"),
        "SetFloat64": (37, "indn"),
        "GetInt32": (9, "ondn"),
        "SetInt32": (9, "indn"),
        "GetFloat32": (9, "ondn"),
        "SetFloat32": (9, "indn"),
        "GetClock": (9, "ond"),
        "SetClock": (9, "ind"),
        "GetContinuousStateDerivatives": (10, "ds"),
        "GetDirectionalDerivative": (26, "onimdmdn"),
        "GetAdjointDerivative": (26, "onimdndm"),
    },
}
LOGGERS = {
    2: ctypes.CFUNCTYPE(None, c_void_p, c_char_p, c_int, c_char_p, c_char_p),
    3: ctypes.CFUNCTYPE(None, c_void_p, c_int, c_char_p, c_char_p),
}


class Host:
    def __init__(self, library, token, version, references, seed):
        self.random = random.Random(seed)
        self.library = ctypes.CDLL(library)
        self.version = version
        self.token = token.encode()
        self.states_there = references.pop("states")
        self.references = references
        self.messages = []
        self.logger = LOGGERS[version](lambda *given: self.messages.append(given[-1]))
        callbacks = [ctypes.cast(self.logger, c_void_p).value, None, None, None, None]
        self.callbacks = (c_void_p * 5)(*callbacks)
        self.instances, self.states, self.counts = [], [], {}
        self.kept = None
        self.instance = c_void_p(None)

    # -- arguments, most of them sensible --------------------------------------------------

    def number(self):
        r = self.random
        return r.choice(ODD) if r.random() < 0.02 else r.gauss(0, 1) * 10 ** r.uniform(-6, 1)

    def pointer(self, array):
        return None if self.random.random() < 0.03 else array

    def names(self, kind):
        r = self.random
        known = self.references[kind if r.random() < 0.9 else r.choice([*self.references])]
        odd = 0.1 if r.random() < 0.1 else 0.0
        chosen = (
            r.choice((r.randrange(2**32), r.randrange(200)) if r.random() < odd else known)
            for _ in range(ROOM)
        )
        return self.pointer((c_uint32 * ROOM)(*chosen))

    def argument(self, letter, counts):
        r = self.random
        if letter == "d":
            return self.pointer((c_double * ROOM)(*(self.number() for _ in range(ROOM))))
        if letter == "f":
            return self.pointer((c_byte * ROOM)())
        if letter in "io":
            return self.names("inputs" if letter == "i" else "outputs")
        if letter in "th":
            value = r.uniform(0, 10) if letter == "t" else 10 ** r.uniform(-5, -2)
            return c_double(r.choice((*ODD, -1.0)) if r.random() < 0.02 else value)
        if letter == "x":
            return c_double(1e-6)
        if letter == "b":
            return (c_int if self.version == 2 else c_bool)(r.random() < 0.5)
        wrong = r.random() < (0.3 if letter == "s" else 0.03)
        return c_size_t(r.randrange(ROOM) if wrong else counts[letter])

    # -- calls ------------------------------------------------------------------------------

    def call(self, name, *arguments):
        heard = len(self.messages)
        function = getattr(self.library, f"fmi{self.version}{name}")
        function.restype = c_int
        status = function(self.instance, *arguments)
        self.counts.setdefault(name, [0, 0])[status != 0] += 1
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
            kind = r.choice((-1, 2)) if r.random() < 0.02 else int(not exchange)
            suffix, given = "", (name, kind, token, None, byref(self.callbacks), 0, 1)
        else:
            suffix = "ModelExchange" if exchange else "CoSimulation"
            flags = c_bool(r.random() < 0.02), c_bool(r.random() < 0.7), None, c_size_t(0)
            given = name, token, None, c_bool(False), c_bool(True), *(() if exchange else flags)
            given += (None, self.logger, *(() if exchange else (None,)))
        make = getattr(self.library, f"fmi{self.version}Instantiate{suffix}")
        make.restype = c_void_p
        if made := make(*given):
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
        state = "FMUstate" if self.version == 2 else "FMUState"
        none = not self.states or r.random() < 0.05
        at = c_void_p(None if none else r.choice(self.states))
        kind = r.randrange(5)
        if kind == 0:
            held = at if r.random() < 0.3 else c_void_p(None)
            status = self.call(f"Get{state}", byref(held) if r.random() < 0.97 else None)
            if not status and held.value not in self.states:
                self.states.append(held.value)
        elif kind == 1:
            self.call(f"Set{state}", at)
        elif kind == 2 and (len(self.states) > 3 or r.random() < 0.05):
            before = at.value
            if not self.call(f"Free{state}", byref(at)) and before and r.random() < 0.9:
                self.states.remove(before)  # else it is used after it is freed
        elif kind == 3:
            size = c_size_t()
            if self.call(f"Serialized{state}Size", at, byref(size)):
                return
            room = (ctypes.c_char * size.value)()
            given = c_size_t(size.value if r.random() < 0.8 else r.randrange(size.value))
            if not self.call(f"Serialize{state}", at, self.pointer(room), given):
                self.kept = room
        elif kind == 4 and self.kept is not None:
            data = bytearray(self.kept)
            if r.random() < 0.5:
                data[r.randrange(len(data))] ^= 1 << r.randrange(8)
            room = (ctypes.c_char * len(data)).from_buffer(data)
            new = c_void_p(None)
            size = c_size_t(len(data) if r.random() < 0.8 else r.randrange(len(data)))
            name = f"{'DeSerialize' if self.version == 2 else 'Deserialize'}{state}"
            if not self.call(name, self.pointer(room), size, byref(new)):
                self.states.append(new.value)

    def run(self, calls):
        r = self.random
        listed = CALLS[self.version]
        names, weights = ["", *listed], [78, *(w for w, _ in listed.values())]
        while sum(map(sum, self.counts.values())) < calls:
            if not self.instances or (len(self.instances) < 3 and r.random() < 0.01):
                self.instantiate()
                continue
            if r.random() < 0.001:
                self.free_instance(r.choice(self.instances))
                continue
            self.instance = c_void_p(r.choice(self.instances) if r.random() < 0.99 else None)
            (name,) = r.choices(names, weights)
            if name:
                n, m = (r.randrange(ROOM if r.random() < 0.3 else 6) for _ in range(2))
                counts = {"n": n, "m": m, "s": self.states_there}
                self.call(name, *(self.argument(letter, counts) for letter in listed[name][1]))
            else:
                self.saved()
            del self.messages[:-1000]
        while self.instances:
            self.free_instance(self.instances[-1])
        print(json.dumps(self.counts))


library, token, version, references, seed, calls = sys.argv[1:]
Host(library, token, int(version), json.loads(references), int(seed)).run(int(calls))
