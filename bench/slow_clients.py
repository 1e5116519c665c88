"""What 2,000 idle and 200 slow connections cost the predictions of others.

    cargo build --release
    python3 bench/slow_clients.py

Lets a server learn a small task and sends predictions at a constant rate, `--rate` a second, over eight connections: first
alone, then while idle clients hold connections open and slow ones send a head, or the body of a prediction, one byte at a time, and
come back when they are hung up on; in turns, `--rounds` times. A prediction's time counts from when it was due. Prints the
medians of p50 and p99 over the rounds, and their ratio.
"""

import argparse
import asyncio
import json
import pathlib
import statistics
import tempfile
import time

from growth import Server, json_events

MODEL = "/v1/models/default"
WINDOW = {"follower_speed_mps": [14.0] * 10, "leader_speed_mps": [14.0] * 10, "spacing_m": [20.0] * 10}


def request(body):
    head = f"POST {MODEL}/predict HTTP/1.1\r\nhost: x\r\ncontent-type: application/json\r\ncontent-length: {len(body)}\r\n\r\n"
    return (head + body).encode()


async def again(client):
    """A client that comes back whenever it is hung up on."""
    while True:
        try:
            await client()
        except OSError:
            pass
        await asyncio.sleep(0.5)


async def idle(address):
    """Asks once, and holds the connection."""
    reader, writer = await asyncio.open_connection(*address)
    try:
        writer.write(b"GET /healthz HTTP/1.1\r\nhost: x\r\n\r\n")
        while await reader.read(4096):
            pass
    finally:
        writer.close()


async def slow(address, message):
    """Sends a byte each half second."""
    _, writer = await asyncio.open_connection(*address)
    try:
        for byte in message:
            writer.write(bytes([byte]))
            await writer.drain()
            await asyncio.sleep(0.5)
    finally:
        writer.close()


async def predictions(address, rate, seconds, connections=8):
    """Seconds from when each was due to its answer."""
    message, taken, began = request(json.dumps({"windows": [WINDOW]})), [], time.perf_counter()

    async def one(first):
        reader, writer = await asyncio.open_connection(*address)
        for number in range(first, int(rate * seconds), connections):
            due = began + number / rate
            await asyncio.sleep(max(0.0, due - time.perf_counter()))
            writer.write(message)
            head = await reader.readuntil(b"\r\n\r\n")
            assert head.startswith(b"HTTP/1.1 200"), head
            length = next(int(line.split(b":")[1]) for line in head.split(b"\r\n") if line.lower().startswith(b"content-length"))
            await reader.readexactly(length)
            taken.append(time.perf_counter() - due)
        writer.close()

    await asyncio.gather(*(one(first) for first in range(connections)))
    return taken


def percentiles(taken):
    ordered = sorted(taken)
    return [1e3 * ordered[int(share * len(ordered))] for share in (0.5, 0.99)]


async def measured(address, args):
    alone, beside = [], []
    for _ in range(args.rounds):
        alone.append(percentiles(await predictions(address, args.rate, args.seconds)))
        message = request(json.dumps({"windows": [WINDOW]}))
        others = [asyncio.create_task(again(lambda: idle(address))) for _ in range(args.idle)]
        others += [asyncio.create_task(again(lambda: slow(address, message))) for _ in range(args.slow)]
        await asyncio.sleep(2)
        beside.append(percentiles(await predictions(address, args.rate, args.seconds)))
        for other in others:
            other.cancel()
        await asyncio.gather(*others, return_exceptions=True)
        await asyncio.sleep(2)
    return [[statistics.median(column) for column in zip(*rounds)] for rounds in (alone, beside)]


def main():
    cli = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    cli.add_argument("--idle", type=int, default=2000)
    cli.add_argument("--slow", type=int, default=200)
    cli.add_argument("--rate", type=float, default=300)
    cli.add_argument("--seconds", type=float, default=5)
    cli.add_argument("--rounds", type=int, default=3)
    cli.add_argument("--binary", default="target/release/headway")
    args = cli.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        server = Server(args.binary, pathlib.Path(folder, "headway.db"))
        server.learn("default", "fast", json_events(0, 60, 40))
        host, port = server.address.rsplit(":", 1)
        alone, beside = asyncio.run(measured((host, int(port)), args))
        server.stop()
    print("| predictions, ms | alone | beside them | ratio |\n| --- | --- | --- | --- |")
    for name, before, after in zip(("p50", "p99"), alone, beside):
        print(f"| {name} | {before:.2f} | {after:.2f} | {after / before:.2f} |")


if __name__ == "__main__":
    main()
