# SPDX-License-Identifier: Apache-2.0
"""libRLRAudioPropagation.so as a program in Python drives it, by ctypes and declarations of this file alone: exported names, levels in the open
against 1 / (4 pi r), simulations of a shoebox and a house, and the bits of `earshot rir` at the settings that the library names.

  rlr_library_test.py LIBRARY EARSHOT
"""
import ctypes
import math
import os
import pathlib
import shutil
import struct
import subprocess
import sys
import tempfile

LIBRARY, EARSHOT = (os.path.abspath(name) for name in sys.argv[1:])
FLOAT3, FLOAT4 = ctypes.c_float * 3, ctypes.c_float * 4
SIZE, FLOAT, BOOL, TEXT, CONTEXT = ctypes.c_size_t, ctypes.c_float, ctypes.c_uint8, ctypes.c_char_p, ctypes.c_void_p
OK, INVALID, BAD_RATE, NO_CONTEXT, UNSUPPORTED = 0, 2001, 2002, 2005, 2019
MONO, BINAURAL, AMBISONICS = 1, 3, 7


class Configuration(ctypes.Structure):
    _pack_ = 1
    _fields_ = [
        *((name, SIZE) for name in "thisSize frequencyBands directSHOrder indirectSHOrder directRayCount indirectRayCount indirectRayDepth "
                                   "sourceRayCount sourceRayDepth maxDiffractionOrder threadCount".split()),
        *((name, FLOAT) for name in "sampleRate maxIRLength unitScale globalVolume".split()),
        *((name, FLOAT3) for name in "hrtfRight hrtfUp hrtfBack".split()),
        *((name, BOOL) for name in "direct indirect diffraction transmission meshSimplification temporalCoherence".split()),
    ]


class Layout(ctypes.Structure):
    _pack_ = 1
    _fields_ = [("channelCount", SIZE), ("type", ctypes.c_int)]


class Box(ctypes.Structure):
    _pack_ = 1
    _fields_ = [(name, TEXT) for name in "xMin xMax yMin yMax zMin zMax".split()]


class Ray(ctypes.Structure):
    _pack_ = 1
    _fields_ = [("origin", FLOAT3), ("direction", FLOAT3), ("tMin", FLOAT), ("tMax", FLOAT), ("hit", ctypes.c_int), ("normal", FLOAT3)]


lib = ctypes.CDLL(LIBRARY)
FUNCTIONS = {
    "ContextConfigurationDefault": [ctypes.POINTER(Configuration)],
    "CreateContext": [ctypes.POINTER(CONTEXT), ctypes.POINTER(Configuration)],
    "DestroyContext": [CONTEXT],
    "ResetContext": [CONTEXT, ctypes.POINTER(Configuration)],
    "AddSource": [CONTEXT],
    "ClearSources": [CONTEXT],
    "GetSourceCount": [CONTEXT],
    "SetSourcePosition": [CONTEXT, SIZE, FLOAT3],
    "SetSourceRadius": [CONTEXT, SIZE, FLOAT],
    "AddListener": [CONTEXT, ctypes.POINTER(Layout)],
    "ClearListeners": [CONTEXT],
    "GetListenerCount": [CONTEXT],
    "SetListenerPosition": [CONTEXT, SIZE, FLOAT3],
    "SetListenerOrientationQuaternion": [CONTEXT, SIZE, FLOAT4],
    "SetListenerRadius": [CONTEXT, SIZE, FLOAT],
    "SetListenerHRTF": [CONTEXT, SIZE, TEXT],
    "AddObject": [CONTEXT],
    "ClearObjects": [CONTEXT],
    "GetObjectCount": [CONTEXT],
    "SetObjectPosition": [CONTEXT, SIZE, FLOAT3],
    "SetObjectOrientationQuaternion": [CONTEXT, SIZE, FLOAT4],
    "SetObjectMeshOBJ": [CONTEXT, SIZE, TEXT, TEXT],
    "SetObjectMeshPLY": [CONTEXT, SIZE, TEXT, TEXT],
    "SetObjectBox": [CONTEXT, SIZE, FLOAT3, FLOAT3, ctypes.POINTER(Box)],
    "AddMeshVertices": [CONTEXT, ctypes.POINTER(FLOAT), SIZE],
    "AddMeshIndices": [CONTEXT, ctypes.POINTER(ctypes.c_uint32), SIZE, SIZE, TEXT],
    "FinalizeObjectMesh": [CONTEXT, SIZE],
    "SetMaterialDatabaseJSON": [CONTEXT, TEXT],
    "WriteSceneMeshOBJ": [CONTEXT, TEXT],
    "Simulate": [CONTEXT],
    "GetIRCount": [CONTEXT],
    "GetIRChannelCount": [CONTEXT, SIZE, SIZE],
    "GetIRSampleCount": [CONTEXT, SIZE, SIZE],
    "GetIRChannel": [CONTEXT, SIZE, SIZE, SIZE],
    "WriteIRWave": [CONTEXT, SIZE, SIZE, TEXT],
    "WriteIRMetrics": [CONTEXT, SIZE, SIZE, TEXT],
    "GetIndirectRayEfficiency": [CONTEXT],
    "TraceRayAnyHit": [CONTEXT, ctypes.POINTER(Ray)],
    "TraceRayFirstHit": [CONTEXT, ctypes.POINTER(Ray)],
}
for name, arguments in FUNCTIONS.items():
    function = getattr(lib, "RLRA_" + name)
    function.argtypes = arguments
    function.restype = ctypes.c_int
for name in ("GetSourceCount", "GetListenerCount", "GetObjectCount", "GetIRCount", "GetIRChannelCount", "GetIRSampleCount"):
    getattr(lib, "RLRA_" + name).restype = SIZE
lib.RLRA_GetIRChannel.restype = ctypes.POINTER(FLOAT)
lib.RLRA_GetIndirectRayEfficiency.restype = FLOAT


def call(name, *arguments):
    code = getattr(lib, "RLRA_" + name)(*arguments)
    assert code == OK, f"RLRA_{name} returns {code}"


def default_configuration(**fields):
    configuration = Configuration()
    call("ContextConfigurationDefault", ctypes.byref(configuration))
    for field, value in fields.items():
        setattr(configuration, field, value)
    return configuration


class Context:
    """A context and short names of its calls."""

    def __init__(self, **fields):
        self.handle = CONTEXT()
        call("CreateContext", ctypes.byref(self.handle), ctypes.byref(default_configuration(**fields)))

    def __enter__(self):
        return self

    def __exit__(self, *_):
        call("DestroyContext", self.handle)

    def __call__(self, name, *arguments):
        call(name, self.handle, *arguments)

    def number(self, name, *arguments):
        return getattr(lib, "RLRA_" + name)(self.handle, *arguments)

    def add_source(self, *position):
        self("AddSource")
        self("SetSourcePosition", self.number("GetSourceCount") - 1, FLOAT3(*position))

    def add_listener(self, layout, count, *position):
        self("AddListener", ctypes.byref(Layout(count, layout)))
        self("SetListenerPosition", self.number("GetListenerCount") - 1, FLOAT3(*position))

    def add_mesh(self, vertices, faces_by_category):
        """vertices: a flat list; faces_by_category: flat lists of triangles."""
        self("AddObject")
        self("AddMeshVertices", (FLOAT * len(vertices))(*vertices), len(vertices) // 3)
        for category, indices in faces_by_category.items():
            self("AddMeshIndices", (ctypes.c_uint32 * len(indices))(*indices), len(indices), 3, category.encode())
        self("FinalizeObjectMesh", self.number("GetObjectCount") - 1)

    def add_room(self, size, box=None):
        self("AddObject")
        self("SetObjectBox", self.number("GetObjectCount") - 1, FLOAT3(0, 0, 0), FLOAT3(*size), box)

    def response(self, listener=0, source=0):
        samples = self.number("GetIRSampleCount", listener, source)
        channels = self.number("GetIRChannelCount", listener, source)
        return [self.number("GetIRChannel", listener, source, channel)[:samples] for channel in range(channels)]

    def trace(self, origin, direction, least=0.0, most=1e9, function="TraceRayFirstHit"):
        ray = Ray(FLOAT3(*origin), FLOAT3(*direction), least, most)
        self(function, ctypes.byref(ray))
        return ray


def energy(samples):
    return sum(sample * sample for sample in samples)


def peak_of(samples):
    return max(samples, key=abs)


QUICK = {"indirectRayCount": 200, "maxIRLength": 0.3, "sampleRate": 16000.0}


def test_exports_exactly_the_interface():
    nm = shutil.which("nm")
    if nm is None:
        return
    lines = subprocess.run([nm, "-D", "--defined-only", LIBRARY], capture_output=True, text=True, check=True).stdout.splitlines()
    names = sorted(line.split()[-1] for line in lines)
    assert names == sorted("RLRA_" + name for name in FUNCTIONS), names
    assert len(names) == 39


def test_defaults():
    assert ctypes.sizeof(Configuration) == 11 * 8 + 4 * 4 + 9 * 4 + 6 == 146
    c = default_configuration()
    assert [c.thisSize, c.frequencyBands, c.directSHOrder, c.indirectSHOrder, c.directRayCount, c.indirectRayCount] == [146, 4, 3, 1, 500, 5000]
    assert [c.indirectRayDepth, c.sourceRayCount, c.sourceRayDepth, c.maxDiffractionOrder, c.threadCount] == [200, 200, 10, 10, 1]
    assert [c.sampleRate, c.maxIRLength, c.unitScale, c.globalVolume] == [44100.0, 4.0, 1.0, 1.0]
    assert [*c.hrtfRight, *c.hrtfUp, *c.hrtfBack] == [1, 0, 0, 0, 1, 0, 0, 0, 1]
    assert [c.direct, c.indirect, c.diffraction, c.transmission, c.meshSimplification, c.temporalCoherence] == [1, 1, 1, 1, 0, 0]


def test_codes():
    handle = CONTEXT()
    for fields, code in [({"thisSize": 145}, INVALID), ({"sampleRate": 7000.0}, BAD_RATE), ({"sampleRate": math.nan}, BAD_RATE),
                         ({"maxIRLength": 0.0}, INVALID), ({"unitScale": -1.0}, INVALID), ({"globalVolume": math.inf}, INVALID),
                         ({"frequencyBands": 0}, INVALID), ({"hrtfUp": FLOAT3(1, 0, 0)}, INVALID), ({"hrtfBack": FLOAT3(0, 0, -1)}, INVALID)]:
        assert lib.RLRA_CreateContext(ctypes.byref(handle), ctypes.byref(default_configuration(**fields))) == code, fields
    assert lib.RLRA_ContextConfigurationDefault(None) == INVALID
    assert lib.RLRA_CreateContext(None, ctypes.byref(default_configuration())) == INVALID
    for wrong in (None, 1 << 40, 12345):
        assert lib.RLRA_Simulate(wrong) == NO_CONTEXT
        assert lib.RLRA_GetIRCount(wrong) == 0
        assert not lib.RLRA_GetIRChannel(wrong, 0, 0, 0)
        assert lib.RLRA_DestroyContext(wrong) == NO_CONTEXT
    context = Context(**QUICK)
    for layout, count, code in [(0, 1, INVALID), (8, 1, INVALID), (AMBISONICS, 5, INVALID), (AMBISONICS, 121, INVALID), (AMBISONICS, 9, OK),
                                (BINAURAL, 1, OK), (MONO, 7, OK)]:
        assert lib.RLRA_AddListener(context.handle, ctypes.byref(Layout(count, layout))) == code, (layout, count)
    for layout, channels in ((2, 2), (4, 4), (5, 6), (6, 8)):
        assert lib.RLRA_AddListener(context.handle, ctypes.byref(Layout(channels, layout))) == OK
    assert lib.RLRA_SetListenerHRTF(context.handle, 1, b"/nowhere.sofa") == INVALID
    assert lib.RLRA_SetListenerHRTF(context.handle, 0, b"x.sofa") == UNSUPPORTED
    assert lib.RLRA_SetListenerHRTF(context.handle, 1, None) == OK
    assert lib.RLRA_SetMaterialDatabaseJSON(context.handle, b"/nowhere.json") == INVALID
    assert lib.RLRA_FinalizeObjectMesh(context.handle, 0) == INVALID
    assert lib.RLRA_SetSourcePosition(context.handle, 0, FLOAT3(0, 0, 0)) == INVALID
    assert lib.RLRA_WriteSceneMeshOBJ(context.handle, b"/proc/nowhere/x.obj") not in (OK, INVALID)
    call("DestroyContext", context.handle)
    assert lib.RLRA_DestroyContext(context.handle) == NO_CONTEXT  # the handle is not given out again
    with Context(**QUICK) as other:
        assert other.handle.value != context.handle.value


def test_level_in_the_open():
    for volume, distance, unit in ((1.0, 2.0, 1.0), (0.25, 7.0, 1.0), (3.0, 150.0, 0.01)):
        with Context(globalVolume=volume, unitScale=unit, **QUICK) as context:
            context.add_source(0, 0, 0)
            context.add_listener(MONO, 1, 0, 0, distance)
            context("Simulate")
            (samples,) = context.response()
            metres = distance * unit
            expected = volume / (4 * math.pi * metres)
            # An impulse between two samples: its area is the pressure.  Air takes less than 1 % within 10 m.
            assert abs(sum(samples) / expected - 1) < 0.01, (sum(samples), expected)
            assert abs(samples.index(max(samples)) / 16000 - metres / 343.2) < 1.5 / 16000


def test_shoebox():
    box = Box(b"wall", b"wall", b"floor", b"acoustic_tile", None, b"no such thing")
    with Context(**{**QUICK, "maxIRLength": 1.5}) as context, tempfile.TemporaryDirectory() as folder:
        context.add_room((6, 3, 4), ctypes.byref(box))
        context.add_source(1, 1, 1)
        context.add_source(5, 2, 3)
        context.add_listener(BINAURAL, 2, 3, 1.5, 2)
        context.add_listener(AMBISONICS, 9, 3, 1.5, 2)
        context.add_listener(MONO, 1, 2, 1, 3)
        context("Simulate")
        assert context.number("GetIRCount") == 6
        for source in range(2):
            assert [len(context.response(listener, source)) for listener in range(3)] == [2, 9, 1]
            for listener in range(3):
                for samples in context.response(listener, source):
                    assert all(map(math.isfinite, samples)) and 0 < len(samples) <= 24000 and energy(samples) > 0
        assert context.number("GetIndirectRayEfficiency") > 0.99
        # The first source is on the left of a listener that looks along -z, and on the right after half a turn.
        left, right = context.response(0, 0)
        assert energy(left) > 1.2 * energy(right)
        context("SetListenerOrientationQuaternion", 0, FLOAT4(0, 0, 1, 0))
        context("Simulate")
        left, right = context.response(0, 0)
        assert energy(right) > 1.2 * energy(left)
        path = pathlib.Path(folder)
        context("WriteIRMetrics", 0, 0, str(path / "metrics.txt").encode())
        rows = [line.split() for line in (path / "metrics.txt").read_text().splitlines() if not line.startswith("#")]
        assert len(rows) == 4 and all(len(row) == 8 for row in rows)
        assert all(0.1 < float(row[1]) < 3 for row in rows), rows
        context("WriteIRWave", 1, 1, str(path / "ir.wav").encode())
        header = (path / "ir.wav").read_bytes()
        at = header.index(b"fmt ")
        assert struct.unpack("<HHI", header[at + 8:at + 16])[1:] == (9, 16000)
        # Rays in units, any length of direction; the floor is 1.5 below, the wall at x = 6.
        for function in ("TraceRayFirstHit", "TraceRayAnyHit"):
            ray = context.trace((3, 1.5, 2), (0, -2, 0), function=function)
            assert ray.hit == 1 and abs(ray.tMax - 0.75) < 1e-6 and ray.normal[0] == 0 == ray.normal[2] and ray.normal[1] != 0
        assert context.trace((3, 1.5, 2), (1, 0, 0), most=2.9).hit == 0
        assert abs(context.trace((3, 1.5, 2), (1, 0, 0), least=2.5).tMax - 3) < 1e-6
        assert context.trace((3, 1.5, 2), (1, 0, 0), least=3.5).hit == 0
        # An object that moves into the line of sight, and away again.
        before = context.response(2, 0)
        context("AddObject")
        context("SetObjectBox", 1, FLOAT3(-0.5, -0.5, -0.05), FLOAT3(0.5, 0.5, 0.05), None)
        context("SetObjectPosition", 1, FLOAT3(1.5, 1, 2))
        assert context.trace((1, 1, 1), (1, 0, 2), most=1).hit == 1
        context("SetObjectOrientationQuaternion", 1, FLOAT4(math.sqrt(0.5), 0, math.sqrt(0.5), 0))
        assert context.trace((1.4, 1, 1), (0, 0, 2), most=1).hit == 0
        context("Simulate")
        assert context.response(2, 0) != before
        context("SetObjectPosition", 1, FLOAT3(1000, 0, 0))
        assert context.trace((1, 1, 1), (1, 0, 2), most=1).hit == 0
        context("ResetContext", ctypes.byref(default_configuration(**QUICK)))
        assert context.number("GetIRCount") == context.number("GetSourceCount") == context.number("GetObjectCount") == 0


def read_obj(path):
    """Vertices and the triangles of each material."""
    vertices, faces, material = [], {}, None
    for line in path.read_text().splitlines():
        words = line.split()
        if words[:1] == ["v"]:
            vertices += map(float, words[1:4])
        elif words[:1] == ["usemtl"]:
            material = line[7:]
        elif words[:1] == ["f"]:
            faces.setdefault(material, []).extend(int(word.split("/")[0]) - 1 for word in words[1:4])
    return vertices, faces


def bits_of_rir(folder, scene, layout, context, listener=0, source=0, points=("", ""), extra=()):
    """The response that `earshot rir` computes at the settings which the library names, as bytes of samples."""
    context("WriteIRMetrics", listener, source, str(folder / "metrics.txt").encode())
    (settings,) = (line[len("# earshot rir "):] for line in (folder / "metrics.txt").read_text().splitlines() if line.startswith("# earshot rir"))
    command = [EARSHOT, "rir", str(scene), "--source", points[0], "--listener", points[1], "--channels", layout, "--out", str(folder / "rir.wav"),
               *settings.split(), *extra]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, f"{command}: {done.stderr}"
    return (folder / "rir.wav").read_bytes()


def compare_with_rir(folder, scene, context, places, extra=()):
    """All listeners of `context`, as bits of WAV files."""
    for listener, (layout, place) in enumerate(places["listeners"]):
        for source, position in enumerate(places["sources"]):
            context("WriteIRWave", listener, source, str(folder / "library.wav").encode())
            points = [",".join(str(value) for value in point) for point in (position, place)]
            bits = bits_of_rir(folder, scene, layout, context, listener, source, points, extra)
            assert bits == (folder / "library.wav").read_bytes(), f"{scene} {layout}: the bits differ"


DATABASE = """{"materials": [
  {"name": "fallback", "labels": ["default"], "absorption": [125, 0.1, 4000, 0.2], "scattering": [125, 0.3, 4000, 0.3]},
  {"name": "lab wall", "labels": ["wall", "partition"], "absorption": [125, 0.2, 4000, 0.08], "scattering": [125, 0.1, 4000, 0.2],
   "transmission": [125, 0.03, 4000, 0.002], "damping": [125, 0, 4000, 0], "speed": 1500, "density": 998.65},
  {"name": "soft", "labels": ["floor", "floor", "table"], "absorption": [125, 0.05, 4000, 0.6], "scattering": [125, 0.2, 4000, 0.4]}
]}"""


def test_bits_of_a_shoebox():
    for fields in ({}, {"frequencyBands": 8, "indirectSHOrder": 2, "globalVolume": 0.25, "diffraction": 0}, {"direct": 0, "maxIRLength": 4.0},
                   {"indirect": 0, "threadCount": 2}):
        with Context(**{**QUICK, **fields}) as context, tempfile.TemporaryDirectory() as name:
            folder = pathlib.Path(name)
            (folder / "database.json").write_text(DATABASE)
            context("SetMaterialDatabaseJSON", str(folder / "database.json").encode())
            context.add_room((5.5, 2.75, 4.25), ctypes.byref(Box(b"north wall", b"WALL-lamp", b"floor", b"ceiling", None, b"# odd #")))
            context.add_room((0.5, 0.75, 0.5), ctypes.byref(Box(*[b"vegetable"] * 6)))
            context("SetObjectPosition", 1, FLOAT3(2.5, 0.1, 1.7))
            context("SetObjectOrientationQuaternion", 1, FLOAT4(0.9, 0, 0.3, 0))
            places = {"sources": [(1, 1.5, 1), (4.5, 1, 3.75)],
                      "listeners": [("mono", (3, 1.25, 3)), ("binaural", (1.5, 1.75, 3.5)), ("ambisonic:2", (4, 1.5, 1))]}
            for position in places["sources"]:
                context.add_source(*position)
            for (layout, place), (kind, count) in zip(places["listeners"], ((MONO, 1), (BINAURAL, 2), (AMBISONICS, 9))):
                context.add_listener(kind, count, *place)
            context("Simulate")
            context("WriteSceneMeshOBJ", str(folder / "scene.obj").encode())
            (folder / "scene.yaml").write_text("mesh: scene.obj\nmaterials: database.json\nlabel_matching: legacy_substring\n")
            compare_with_rir(folder, folder / "scene.yaml", context, places)


def test_bits_of_a_house():
    """A house that the program exports by its own OBJ is not at hand, so a two-storey house of boxes with doors is built here."""
    walls = []

    def box(low, high):
        first = len(walls) // 3
        for corner in range(8):
            walls.extend(high[axis] if corner >> axis & 1 else low[axis] for axis in range(3))
        faces = ((0, 4, 6), (0, 6, 2), (1, 3, 7), (1, 7, 5), (0, 1, 5), (0, 5, 4), (2, 6, 7), (2, 7, 3), (0, 2, 3), (0, 3, 1), (4, 5, 7), (4, 7, 6))
        return [first + corner for face in faces for corner in face]

    faces = {"floor": box((0, -0.2, 0), (10, 0, 8)) + box((0, 2.6, 0), (10, 2.8, 5)), "ceiling": box((0, 5.4, 0), (10, 5.6, 8)),
             "wall": box((-0.2, 0, 0), (0, 5.4, 8)) + box((10, 0, 0), (10.2, 5.4, 8)) + box((0, 0, -0.2), (10, 5.4, 0)) + box((0, 0, 8), (10, 5.4, 8.2))
             + box((4.9, 0, 0), (5.1, 2.6, 3.5)) + box((4.9, 0, 4.5), (5.1, 2.6, 8)), "table": box((2, 0.7, 2), (3.2, 0.75, 2.8))}
    with Context(indirectRayCount=500, sampleRate=22050.0) as context, tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        context.add_mesh(walls, faces)
        places = {"sources": [(1.5, 1.5, 4)], "listeners": [("binaural", (8, 1.5, 2)), ("binaural", (8, 4.5, 2))]}
        context.add_source(*places["sources"][0])
        for _, place in places["listeners"]:
            context.add_listener(BINAURAL, 2, *place)
        context("Simulate")
        assert all(energy(samples) > 0 for listener in range(2) for samples in context.response(listener))
        context("WriteSceneMeshOBJ", str(folder / "house.obj").encode())
        compare_with_rir(folder, folder / "house.obj", context, places)
        # A file that was written is read again by name of its format, with one category for all.
        with Context(**QUICK) as again:
            again("AddObject")
            again("SetObjectMeshOBJ", 0, str(folder / "house.obj").encode(), b"wall")
            assert lib.RLRA_SetObjectMeshPLY(again.handle, 0, str(folder / "house.obj").encode(), None) == INVALID
            again("WriteSceneMeshOBJ", str(folder / "again.obj").encode())
            assert len(read_obj(folder / "again.obj")[1]["wall"]) == sum(map(len, faces.values()))


def test_head_filters():
    """Axes of the HRTF that are turned sound as a listener that is turned; a measured head as `earshot rir --hrtf`."""
    def ears(orientation, **fields):
        with Context(**QUICK, **fields) as context:
            context.add_room((6, 3, 4))
            context.add_source(1, 1, 1)
            context.add_listener(BINAURAL, 2, 3, 1.5, 2)
            context("SetListenerOrientationQuaternion", 0, FLOAT4(*orientation))
            context("Simulate")
            return context.response()
    half_turn = {"hrtfRight": FLOAT3(-2, 0, 0), "hrtfUp": FLOAT3(0, 1, 0), "hrtfBack": FLOAT3(0, 0, -1)}
    assert ears((1, 0, 0, 0), **half_turn) == ears((0, 0, 3, 0)) != ears((1, 0, 0, 0))
    data = pathlib.Path(os.environ.get("EARSHOT_DATA", pathlib.Path(__file__).parents[2] / "../shared/data"))
    head = data / "hrtf/MIT_KEMAR_normal_pinna.sofa"
    if not head.exists():
        print(f"no test data: {head} (set EARSHOT_DATA)")
        return
    with Context(**QUICK) as context, tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        context.add_room((5, 3, 4))
        context.add_source(1, 1, 1)
        context.add_listener(BINAURAL, 2, 3, 1.5, 2)
        context("SetListenerHRTF", 0, str(head).encode())
        context("Simulate")
        context("WriteSceneMeshOBJ", str(folder / "scene.obj").encode())
        places = {"sources": [(1, 1, 1)], "listeners": [("binaural", (3, 1.5, 2))]}
        compare_with_rir(folder, folder / "scene.obj", context, places, ("--hrtf", str(head)))


def test_settings_of_the_environment():
    def response(**variables):
        program = (f"import sys; sys.argv = ['', {LIBRARY!r}, {EARSHOT!r}]; import importlib.util as u; "
                   f"s = u.spec_from_file_location('t', {__file__!r}); t = u.module_from_spec(s); s.loader.exec_module(t); t.print_response()")
        done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, env={**os.environ, **variables})
        return done.stdout if done.returncode == 0 else None

    first = response()
    assert first and first == response(EARSHOT_SEED="0") == response(EARSHOT_PRESET="")
    assert response(EARSHOT_SEED="7") not in (None, first)
    assert response(EARSHOT_PRESET="fast") not in (None, first)
    assert response(EARSHOT_PRESET="best") is None and response(EARSHOT_SEED="-1") is None


def print_response():
    with Context(**QUICK) as context:
        context.add_room((4, 3, 5))
        context.add_source(1, 1, 1)
        context.add_listener(MONO, 1, 3, 1, 4)
        context("Simulate")
        print(context.response()[0][:2000])


def test_temporal_coherence_reduces_noise():
    """Late energy of a listener that goes on in small steps scatters less from step to step than without."""
    def scatter(coherence):
        with Context(temporalCoherence=coherence, **{**QUICK, "indirectRayCount": 16}) as context:
            context.add_room((6, 3, 4))
            context.add_source(1, 1, 1)
            context.add_listener(MONO, 1, 3, 1.5, 2)
            levels = []
            for step in range(30):
                context("SetListenerPosition", 0, FLOAT3(3 + 0.02 * step, 1.5, 2))
                context("Simulate")
                (samples,) = context.response()
                levels.append(10 * math.log10(energy(samples[1600:3200])))
            late = levels[10:]
            return sum((b - a) ** 2 for a, b in zip(late, late[1:])) / len(late)
    assert scatter(1) < 0.5 * scatter(0)


def main():
    tests = [value for name, value in sorted(globals().items()) if name.startswith("test_")]
    for test in tests:
        test()
        print(f"{test.__name__}: ok", flush=True)


if __name__ == "__main__":
    main()
