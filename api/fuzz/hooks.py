"""What run.py adds to schemathesis: who may do what, which refusals the contract cannot foresee, likelier input, counts."""

import collections
import json
import os
import pathlib
import re

import schemathesis
from schemathesis.core.failures import ServerError
from schemathesis.openapi.checks import EnsureResourceAvailability, RejectedPositiveData, UseAfterFree

from traffic import followed

CALLER, KEY = os.environ["HEADWAY_CALLER"], os.environ["HEADWAY_KEY"]
# Keys that must outlive the run.
SPARED = os.environ["HEADWAY_SPARED"].split()
COUNTED = pathlib.Path(os.environ["HEADWAY_COUNTED"])
HORIZON = 10

# Refusals of requests that fit the contract, as `code error/member: detail`, and why a schema does not foresee them.
FORESEEN = {
    "no_event_accepted ": "whether numbers are traffic is for physics to say; the answer judges event by event",
    "idempotency_mismatch ": "an Idempotency-Key belongs to the first request that came with it",
    "method_needs_events ": "which methods take a file of weights, descriptions say",
    "tasks_under_way ": "whether a model learns just now, the server knows",
    "precondition_failed ": "If-Match is compared with the model's ETag",
    "version_not_found ": "a body may name a version that is not there",
    "invalid_body unknown_batch/": "a body may name a batch that is not there",
    "invalid_body invalid_value/method: a fork goes on": "a fork's method is that of its model",
    "invalid_body window_length/": "how long a window is, is the model's setting",
    "invalid_body out_of_range/expires_at: it lies in the past": "a schema does not know what time it is",
    "invalid_body not_limited/models: admin": "which members exclude each other, descriptions say",
    "invalid_body out_of_range/mean_speed_mps: .*low <= high": "a schema does not compare members",
    "invalid_body preset [a-z]+ names columns, and a JSON event has none": "which option goes with which body, descriptions say",
    "invalid_query option_not_applicable/": "which option goes with which body, descriptions say",
    "invalid_query invalid_option/min_(duration_s|spacing_m): .* is not within": "a schema does not compare parameters",
    "invalid_query missing_option/": "a spacing that is not net needs lengths, as descriptions say",
    "invalid_query unknown_token/page_token": "whether this list gave a token, the server knows",
    "invalid_query out_of_range/wait_s: 0 to 1$": "the run sets the greatest wait to 1 s, so as not to wait",
    "invalid_settings invalid_setting/[a-z0-9_]*: (?!.*(is not within|invalid type|unknown|expected))":
        "each setting is right by itself: which go together, with a method, or with the model's in a task, descriptions say",
}
# The same where a body is not JSON, or says that it is compressed.
FORESEEN_OF_BYTES = {"(malformed|truncated|invalid)_(body|archive) ": "what rows, columns and compressed bytes may be, descriptions say"}

# The same in the one text that the Open Inference Protocol has for errors.
FORESEEN_OF_INFERENCE = {
    "tensor .*shape .* elements": "a schema does not count what a shape asks for",
    "tensor .*shape .* is taken": "which input has which shape, descriptions say",
    "tensor .*(steps; exactly the last|windows; 1 to)": "how long a window is, and how many there may be, is a setting",
    "tensor .*(either data or binary_data_size|and [0-9]+ bytes are left|no multiple of 4)": "data is in one place, as descriptions say",
    "tensor .*(belongs to a sequence|takes its newest step)": "a step comes with sequence_id, and a window without, as descriptions say",
    "tensor .*element [0-9]+ is .*not within": "nested numbers are within the same bounds as flat ones, as descriptions say",
    "the sequence is not open": "whether a sequence began, the server knows",
    "the sequence began with version": "a sequence stays with its version",
    "inference-header-content-length is": "how long the JSON is, the header says and a schema does not know",
    "(malformed|truncated)_": "what the bytes behind the JSON may be, descriptions say",
    "(numbers, flat or nested|levels of arrays)": "how deep nested numbers are, descriptions say",
    "has no version": "a path may name a version that is not there",
}

# What any call may be answered, as the contract says once for all of them; 500 is in it, and never right.
ANY = {401, 403, 405, 406, 408, 413, 429, 503, 507}

# Calls about the whole server, for whose keys a limit to models is one too many.
FOR_ALL = {"metrics", "createModel", "inferenceStatisticsOfAll"}

answers, excused = collections.Counter(), collections.Counter()


@schemathesis.serializer("application/vnd.sqlite3", "application/x-npy", "application/vnd.apache.parquet", "application/vnd.safetensors")
def as_it_is(ctx, value):
    """Bodies that are nothing but bytes."""
    data = getattr(value, "data", value)
    return data if isinstance(data, bytes) else str(data).encode()


def operation_id(case):
    return case.operation.definition.raw["operationId"]


def foreseen(case, response):
    """Why a refusal of what fits the contract is right; none when any of its errors was not foreseen."""
    try:
        told = json.loads(response.content)
        code, errors = told["code"], told.get("errors", [])
    except (ValueError, TypeError, KeyError):
        return foreseen_of_inference(response)
    where = lambda error: (error.get("parameter") or error.get("pointer") or "").split("/")[-1]
    lines = [f"{code} {error['code']}/{where(error)}: {error['detail']}" for error in errors] or [f"{code} {told['detail']}"]
    raw = operation_id(case) in ("upload", "evaluate", "importVersion", "takeInArchive") and (
        case.media_type != "application/json" or "Content-Encoding" in case.headers)
    known = FORESEEN | (FORESEEN_OF_BYTES if raw else {})
    reasons = [next((why for pattern, why in known.items() if re.match(pattern, line)), None) for line in lines]
    return None if None in reasons else reasons[0]


def foreseen_of_inference(response):
    try:
        error = json.loads(response.content)["error"]
    except (ValueError, TypeError, KeyError):
        return None
    return next((why for pattern, why in FORESEEN_OF_INFERENCE.items() if re.search(pattern, error)), None)


@schemathesis.hook
def filter_failure(context, failure, case, response):
    """Whether there is something to explain."""
    why = None
    if isinstance(failure, (RejectedPositiveData, EnsureResourceAvailability)):
        why = foreseen(case, response)
    elif isinstance(failure, ServerError) and response.status_code == 503 and b"is unloaded; load it first" in response.content:
        why = "a model that was unloaded is not ready, as the protocol has it"
    elif isinstance(failure, UseAfterFree):
        why = "DELETE retracts a batch and revokes a key: both stay in their lists, marked"
    if why:
        excused[why] += 1
    return not why


@schemathesis.check
def answered_as_listed(ctx, response, case):
    """Beside what any call may be answered, `default` hides nothing that an operation does not list."""
    listed = case.operation.responses.status_codes
    assert response.status_code in ANY or str(response.status_code) in listed, f"{response.status_code} is not listed"


@schemathesis.check
def no_further_than_it_may(ctx, response, case):
    """Without a key that has the operation's scope, for the model that it is about, nobody gets past 401 or 403."""
    needs = case.operation.definition.raw.get("security", [{"key": []}])
    if not needs:
        return
    [scopes] = needs[0].values()
    model = str((case.path_parameters or {}).get("model", "elsewhere"))
    if not KEY or response.request.headers.get("Authorization") != f"Bearer {KEY}":
        expected = 401
    elif CALLER == "elsewhere" and (operation_id(case) in FOR_ALL or "admin" in scopes or model != CALLER):
        expected = 403
    elif CALLER not in ("admin", "elsewhere") and scopes and CALLER not in scopes:
        expected = 403
    else:
        return
    # A path or a method that is none is told from one that is closed; neither lets anybody in.
    assert response.status_code in (expected, 404, 405), f"{CALLER} was answered {response.status_code}, not {expected}"


@schemathesis.hook
def filter_case(context, case):
    """Nothing ends the keys of the run, and one model goes on serving."""
    name, path = operation_id(case), case.path_parameters or {}
    if name == "revokeKey":
        return str(path.get("key_id")) not in SPARED
    return name not in ("retractBatch", "rollback") or str(path.get("model")) != "kept"


@schemathesis.hook
def map_case(context, case):
    """Arrays made up at random are hardly ever a window or an event: in half of the valid cases they become one."""
    if not isinstance(case.body, dict) or not case.meta or not case.meta.generation.mode.is_positive:
        return case
    name, body = operation_id(case), case.body
    drawn = len(json.dumps(body, default=str))
    if drawn % 2:
        return case
    if name == "predict":
        for window in body["windows"]:
            stretch(window)
    elif name == "simulate":
        stretch(body["initial"])
    elif name in ("infer", "inferOfVersion"):
        become_inference(body, drawn)
    elif name in ("upload", "evaluate"):
        for number, event in enumerate(body["events"]):
            event |= followed(drawn + number)
    return case


def stretch(window):
    for name, values in window.items():
        window[name] = [values[k % len(values)] for k in range(HORIZON)]


def become_inference(body, drawn):
    """A window, or a step of a sequence that this begins or goes on with."""
    step, parameters = [14, 15, 1, 20 + drawn % 5], body.setdefault("parameters", {})
    tensor = {"name": "window", "datatype": "FP32", "shape": [1, HORIZON, 4], "data": step * HORIZON}
    parameters["sequence_id"] = 0
    if drawn % 3:
        tensor |= {"name": "step", "shape": [1, 4], "data": step}
        parameters |= {"sequence_id": 1 + drawn % 7, "sequence_start": drawn % 5 == 0}
    body["inputs"] = [tensor]


@schemathesis.hook
def after_call(context, case, response):
    answers[f"{operation_id(case)} {response.status_code}"] += 1
    COUNTED.write_text(json.dumps({"answers": answers, "excused": excused}))
