"""The other side of kind `python`: calls functions with artifacts as numpy arrays.

`serve` answers requests on the socket that is its standard input, one after the other; `facts` prints
what counts of this interpreter. Needs nothing but numpy. A message is its length (4 bytes, little-endian)
and a JSON text.
"""

import json
import os
import sys
from importlib.machinery import ModuleSpec


class Artifact:
    """The arrays and texts of an artifact, by name and as attributes; `type` is the name of its type.

    Of names with dots (`mesh.vertices`), the part before the first dot is an artifact itself. It is no
    dictionary, whose methods would hide arrays (`values`), but `dict(artifact)` is one.
    """

    def __init__(self, type, parts):
        self.__dict__.update(type=type, _parts=parts)

    def keys(self):
        return self._parts.keys()

    def __iter__(self):
        return iter(self._parts)

    def __len__(self):
        return len(self._parts)

    def __contains__(self, name):
        return name in self._parts

    def __getitem__(self, name):
        return self._parts[name]

    def __setitem__(self, name, value):
        self._parts[name] = value

    def __getattr__(self, name):
        parts = self.__dict__.get("_parts", {})
        if name in parts:
            return parts[name]
        inner = {k[len(name) + 1 :]: v for k, v in parts.items() if k.startswith(name + ".")}
        if inner and not name.startswith("__"):
            return Artifact(name, inner)
        raise AttributeError(f"`{self.type}` has no `{name}`; it has {', '.join(parts)}")


class Gathered(list):
    """The artifacts of a list input; `None` for one that is missing.

    `labels` has what each is called, by its axes; `missing` why it is missing, or `None`.
    """

    def __init__(self, items, labels):
        super().__init__(None if "missing" in it else read_artifact(**it) for it in items)
        self.labels = labels or [{} for _ in items]
        self.missing = [it.get("missing") for it in items]


class Mistake(Exception):
    """What a function did wrong, in a sentence for the user."""


DTYPES = {
    "F64": "<f8",
    "F32": "<f4",
    "I64": "<i8",
    "U64": "<u8",
    "U32": "<u4",
    "U16": "<u2",
    "U8": "|u1",
}


def read_artifact(type, path):
    """Maps a file: its arrays can be written to, but the file stays as it is."""
    import mmap

    import numpy

    with open(path, "rb") as file:
        data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_COPY)
    start = 8 + int.from_bytes(data[:8], "little")
    header = json.loads(data[8:start])
    texts = header.pop("__metadata__", {})
    values = {}
    for name, entry in header.items():
        count = 1
        for length in entry["shape"]:
            count *= length
        offset = start + entry["data_offsets"][0]
        dtype = numpy.dtype(DTYPES[entry["dtype"]])
        if count == 0:
            values[name] = numpy.empty(entry["shape"], dtype)
        else:
            array = numpy.frombuffer(data, dtype, count, offset)
            values[name] = array.reshape(entry["shape"])
    for name, text in texts.items():
        if not name.startswith("sinew."):
            values[name] = list_or_text(text)
    return of_type(type, values)


def list_or_text(text):
    """A list of texts is stored as one JSON text."""
    if text.startswith("["):
        try:
            items = json.loads(text)
        except ValueError:
            return text
        if all(isinstance(it, str) for it in items):
            return items
    return text


def of_type(type, values):
    """What a function gets: a text as `str`, files as `bytes`, a table as its columns."""
    if type == "text":
        return values["utf8"].tobytes().decode()
    if type == "files":
        return {path: values["file:" + path].tobytes() for path in values["paths"]}
    if type == "table":
        rows = iter(values["numbers"])
        columns = {}
        for head in json.loads(values["columns"]):
            column = next(rows) if head["texts"] is None else head["texts"]
            # The last rows may be means and the like.
            columns[head["name"]] = column[: len(column) - int(values["statistics"])]
        return Artifact(type, columns)
    return Artifact(type, values)


def parts_of(type, value):
    """The arrays and texts of what a function returns for an output."""
    if isinstance(value, Artifact):
        value = dict(value)
    if type == "text":
        if not isinstance(value, str):
            raise Mistake(f"a `text` is a `str`, not {kind_of(value)}")
        return {"utf8": bytes_array(value.encode())}, {}
    if type == "files":
        files = {str(k): v.encode() if isinstance(v, str) else bytes(v) for k, v in value.items()}
        paths = sorted(files)
        return {"file:" + it: bytes_array(files[it]) for it in paths}, {"paths": compact(paths)}
    if type == "table":
        return table_parts(value)
    if not isinstance(value, dict):
        raise Mistake(f"a `{type}` is a dictionary of arrays, not {kind_of(value)}")
    arrays, texts = {}, {}
    for name, item in value.items():
        if isinstance(item, str):
            texts[name] = item
        elif isinstance(item, (list, tuple)) and item and all(isinstance(it, str) for it in item):
            texts[name] = compact(list(item))
        elif is_scalar(item):
            texts[name] = str(item)
        else:
            arrays[name] = plain_array(name, item)
    return arrays, texts


def kind_of(value):
    return f"`{value.__class__.__name__}`"


def is_scalar(value):
    import numpy

    return isinstance(value, (bool, int, float, numpy.generic))


def bytes_array(data):
    import numpy

    return numpy.frombuffer(data, numpy.uint8)


def plain_array(name, value):
    """As numbers of one of the types that artifacts have."""
    import numpy

    if hasattr(value, "toarray"):
        raise Mistake(f"`{name}` is {kind_of(value)}: give its arrays")
    array = numpy.asarray(value)
    if array.dtype.kind == "b":
        wanted = "|u1"
    elif array.dtype.kind == "f":
        wanted = "<f8" if array.dtype.itemsize >= 8 else "<f4"
    elif array.dtype.kind == "i":
        wanted = "<i8"
    elif array.dtype.kind == "u":
        wanted = f"<u{array.dtype.itemsize}"
    else:
        raise Mistake(f"`{name}` is an array of `{array.dtype}`, and artifacts hold numbers")
    return numpy.asarray(array, wanted, order="C")


def table_parts(value):
    """A table from columns, or from a list of records; `error [mm]` is a column with a unit."""
    import numpy

    if isinstance(value, (list, tuple)):
        names = list(dict.fromkeys(name for row in value for name in row))
        value = {name: [row.get(name, float("nan")) for row in value] for name in names}
    if not isinstance(value, dict):
        raise Mistake(f"a `table` is a dictionary of columns or a list of rows, not {kind_of(value)}")
    heads, numbers, n_rows = [], [], None
    for name, column in value.items():
        column = list(column)
        if n_rows not in (None, len(column)):
            raise Mistake(f"column `{name}` has {len(column)} rows, and others {n_rows}")
        n_rows = len(column)
        is_text = bool(column) and all(isinstance(it, str) for it in column)
        if not is_text:
            try:
                numbers.append(numpy.asarray(column, "<f8"))
            except (TypeError, ValueError):
                raise Mistake(f"column `{name}` holds neither numbers nor texts only") from None
        name, _, unit = str(name).partition(" [")
        texts = column if is_text else None
        head = {"name": name, "unit": unit.rstrip("]"), "texts": texts}
        heads.append({**head, "marked": [], "decimals": None})
    table = numpy.array(numbers, "<f8").reshape(len(numbers), n_rows or 0)
    return {"numbers": table}, {"columns": compact(heads), "statistics": "0"}


def compact(value):
    """JSON to the byte as the other side writes it: what is equal need not be written again there."""
    return json.dumps(value, ensure_ascii=False, separators=(",", ":"))


def write_artifact(path, type, version, value):
    arrays, texts = parts_of(type, value)
    names = {dtype: name for name, dtype in DTYPES.items()}
    texts = {**texts, "sinew.type": type, "sinew.version": str(version)}
    # By their bytes, in which order strings compare there.
    texts = sorted(texts.items(), key=lambda it: str(it[0]).encode(errors="surrogatepass"))
    header, offset = {"__metadata__": dict(texts)}, 0
    # Large numbers first, so that all of them are aligned.
    arrays = sorted(arrays.items(), key=lambda it: -it[1].dtype.itemsize)
    for name, array in arrays:
        end = offset + array.nbytes
        dtype = names[array.dtype.str if array.dtype.itemsize > 1 else "|u1"]
        header[name] = {"dtype": dtype, "shape": array.shape, "data_offsets": [offset, end]}
        offset = end
    head = compact(header).encode(errors="surrogatepass")
    head += b" " * (-len(head) % 8)
    with open(path, "r+b", buffering=0) as file:
        file.truncate(0)
        write_all(file, len(head).to_bytes(8, "little") + head)
        for _, array in arrays:
            if array.nbytes:
                write_all(file, memoryview(array).cast("B"))


def write_all(file, data):
    while data:
        data = data[file.write(data) :]


class Modules:
    """Finds the declared modules, and nothing else beside the script."""

    def __init__(self, sources):
        self.sources = sources

    def find_spec(self, name, path=None, target=None):
        return ModuleSpec(name, self) if name in self.sources else None

    def create_module(self, spec):
        return None

    def exec_module(self, module):
        run_source(module, **self.sources[module.__name__])


def run_source(module, path, source):
    module.__file__ = path
    exec(compile(source, path, "exec", dont_inherit=True), module.__dict__)


def load(script, modules):
    """Runs the script once; its functions are called many times."""
    import types

    sys.meta_path.insert(0, Modules(modules))
    module = types.ModuleType("script")
    sys.modules["script"] = module
    run_source(module, **script)
    return module


def call(module, request):
    """Calls a function and writes what it returns."""
    name = request["function"]
    function = getattr(module, name, None)
    if not callable(function):
        raise Mistake(f"the script has no function `{name}`")
    arguments = dict(request["params"])
    for port, given in request["inputs"].items():
        arguments[port] = Gathered(**given) if "items" in given else read_artifact(**given)
    result = function(**arguments)
    leave_if_forked()
    results = by_port(result, request["outputs"])
    for port, output in request["outputs"].items():
        try:
            write_artifact(**output, value=results[port])
        except Mistake as mistake:
            raise Mistake(f"output `{port}`: {mistake}") from None


def by_port(result, outputs):
    if isinstance(result, dict) and result.keys() == outputs.keys():
        return result
    if len(outputs) == 1:
        return dict.fromkeys(outputs, result)
    if not outputs:
        return {}
    found = ", ".join(f"`{it}`" for it in result) if isinstance(result, dict) else kind_of(result)
    wanted = ", ".join(f"`{it}`" for it in outputs)
    raise Mistake(f"it must return a dictionary with the outputs {wanted}, but returned {found}")


def answer(action):
    """Runs something of the user's; the response to the request."""
    try:
        return {"result": action()}
    except Mistake as mistake:
        return {"mistake": str(mistake)}
    except SystemExit as exit:
        return {"mistake": f"it called `sys.exit({exit.code!r})`"}
    except BaseException as error:
        import traceback

        # Without the frames of this file.
        trace = error.__traceback__
        while trace is not None and trace.tb_frame.f_code.co_filename == HERE:
            trace = trace.tb_next
        lines = traceback.format_exception(error.__class__, error, trace)
        last = traceback.format_exception_only(error.__class__, error)[-1].strip()
        return {"mistake": last, "traceback": "".join(lines)}


HERE = answer.__code__.co_filename
OWN_ID = os.getpid()


def leave_if_forked():
    """A fork of the user's may come back here, where it has nothing to say."""
    if os.getpid() != OWN_ID:
        os._exit(0)


def serve():
    import random
    import socket

    channel = socket.socket(fileno=os.dup(0))
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    stdout, stderr = sys.stdout, sys.stderr
    # The working folder is no place for modules.
    sys.path = [it for it in sys.path if it]
    flush = c_flush()

    def receive(size):
        data = b""
        while len(data) < size:
            piece = channel.recv(size - len(data))
            if not piece:
                os._exit(0)
            data += piece
        return data

    module, environment = None, dict(os.environ)
    while True:
        request = json.loads(receive(int.from_bytes(receive(4), "little")))
        if "load" in request:

            def action():
                nonlocal module
                module = load(**request["load"])
        else:
            # What ran before must leave no trace in this one.
            os.chdir(request["folder"])
            os.environ.clear()
            os.environ.update(environment)
            random.seed(0)
            if "numpy" in sys.modules:
                sys.modules["numpy"].random.seed(0)

            def action():
                call(module, request)

        response = answer(action)
        leave_if_forked()
        for stream in (sys.stdout, sys.stderr, stdout, stderr):
            try:
                stream.flush()
            except Exception:
                pass
        sys.stdout, sys.stderr = stdout, stderr
        flush()
        text = json.dumps(response).encode()
        channel.sendall(len(text).to_bytes(4, "little") + text)


def c_flush():
    """What libraries in C print is to be seen as well."""
    try:
        import ctypes

        library = ctypes.CDLL(None)
        return lambda: library.fflush(None)
    except Exception:
        return lambda: None


def facts(packages):
    """Versions, and all files and folders whose change may change them."""
    from importlib import metadata

    implementation = sys.implementation.name.replace("cpython", "CPython")
    version = ".".join(str(it) for it in sys.version_info[:3])
    res = {"python": f"{implementation} {version}"}
    witnesses = {sys.executable, os.path.realpath(sys.executable)}
    witnesses.add(os.path.join(sys.prefix, "pyvenv.cfg"))
    sys.path = [it for it in sys.path if it]
    for folder in sys.path:
        witnesses.add(folder)
        if os.path.isdir(folder):
            names = [it for it in os.listdir(folder) if it.endswith((".pth", ".egg-link"))]
            witnesses.update(os.path.join(folder, it) for it in names)
    missing = []
    for package in packages:
        try:
            found = metadata.distribution(package)
        except metadata.PackageNotFoundError:
            text = content(package, witnesses)
            if text is None:
                missing.append(package)
            else:
                res[package] = text
            continue
        res[package] = found.version
        place = getattr(found, "_path", None)
        if place is not None:
            for it in (place, os.path.join(place, "METADATA"), os.path.join(place, "PKG-INFO")):
                witnesses.add(str(it))
        if '"editable": true' in (found.read_text("direct_url.json") or ""):
            # Its files change without its version.
            res[package] += ", " + (content(package.replace("-", "_"), witnesses) or "editable")
    witnesses = sorted(os.path.abspath(it) for it in witnesses)
    print(json.dumps({"facts": res, "missing": missing, "witnesses": witnesses}))


def content(module, witnesses):
    """A module without a version counts by its source files."""
    import hashlib
    import importlib.util

    try:
        spec = importlib.util.find_spec(module)
    except (ImportError, ValueError):
        return None
    if spec is None:
        return None
    files = []
    if spec.submodule_search_locations:
        for root in spec.submodule_search_locations:
            for folder, folders, names in os.walk(root):
                folders[:] = sorted(it for it in folders if it != "__pycache__")
                witnesses.add(folder)
                files += [os.path.join(folder, it) for it in sorted(names)]
    elif spec.origin and os.path.isfile(spec.origin):
        files.append(spec.origin)
    digest = hashlib.sha256()
    for path in files:
        witnesses.add(path)
        with open(path, "rb") as file:
            line = f"{os.path.basename(path)} {hashlib.sha256(file.read()).hexdigest()}"
        digest.update(line.encode())
    return f"files {digest.hexdigest()[:16]}"


if sys.argv[1:2] == ["facts"]:
    facts(sys.argv[2:])
else:
    serve()
