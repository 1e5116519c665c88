"""What a team would write in Headway's place to serve its network: FastAPI and ONNX Runtime, at their best.

    python3 bench/fastapi_server.py --model model.onnx --port 8000 [--workers 2] [--threads 1]

`POST /predict` takes and answers the JSON of Headway's `POST /v1/models/{model}/predict`. Two uvicorn workers with uvloop and
httptools, orjson both ways, neither an access log nor pydantic, and one thread of ONNX Runtime in each worker. Needs fastapi, uvicorn, uvloop, httptools, orjson, onnxruntime and numpy.
"""

import argparse
import os

import numpy as np
import onnxruntime
import orjson
import uvicorn
from fastapi import FastAPI, Request, Response

app = FastAPI()
MEMBERS = ("follower_speed_mps", "leader_speed_mps", "spacing_m")


def session():
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = int(os.environ.get("ONNX_THREADS", "1"))
    options.inter_op_num_threads = 1
    return onnxruntime.InferenceSession(os.environ["ONNX_MODEL"], options, providers=["CPUExecutionProvider"])


NETWORK = session() if "ONNX_MODEL" in os.environ else None


@app.post("/predict")
async def predict(request: Request):
    windows = orjson.loads(await request.body())["windows"]
    arrays = np.array([[window[member] for member in MEMBERS] for window in windows], np.float32)
    follower, leader, spacing = arrays[:, 0], arrays[:, 1], arrays[:, 2]
    stacked = np.stack([follower, leader, leader - follower, spacing], axis=2)
    raw = NETWORK.run(["accel_mps2"], {"window": stacked})[0][:, 0]
    predictions = [{"accel_mps2": accel, "raw_accel_mps2": accel, "flags": []} for accel in raw.tolist()]
    answer = {"model": "default", "version": 1, "predictions": predictions}
    return Response(orjson.dumps(answer), media_type="application/json")


def main():
    cli = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    cli.add_argument("--model", required=True)
    cli.add_argument("--port", type=int, default=8000)
    cli.add_argument("--workers", type=int, default=2)
    cli.add_argument("--threads", type=int, default=1, help="of ONNX Runtime, in each worker")
    args = cli.parse_args()
    os.environ |= {"ONNX_MODEL": args.model, "ONNX_THREADS": str(args.threads)}
    uvicorn.run("fastapi_server:app", port=args.port, workers=args.workers, loop="uvloop", http="httptools",
                access_log=False, log_level="warning", app_dir=os.path.dirname(os.path.abspath(__file__)))


if __name__ == "__main__":
    main()
