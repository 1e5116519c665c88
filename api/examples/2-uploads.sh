# Uploads: batches of events, in whatever form they are.

url=${HEADWAY_URL:-http://127.0.0.1:8080}

# One step a row. The file may be compressed, and large: it is streamed.
curl -sS --fail-with-body -X POST "$url/v1/models/quick/batches?regime=fast" \
  -H 'Content-Type: text/csv' --data-binary @fast.csv
gzip -c slow.csv | curl -sS --fail-with-body -X POST "$url/v1/models/quick/batches?regime=slow" \
  -H 'Content-Type: text/csv' -H 'Content-Encoding: gzip' --data-binary @-

# One good event and one that cannot be: its follower jumps. The answer says of each bad event where and why.
curl -sS --fail-with-body -X POST "$url/v1/models/quick/batches?source=site-12" -H 'Content-Type: application/json' -d '{"events": [
  {"event_id": "good", "dt_s": 0.1, "spacing_m": [20, 20, 20, 20, 20, 20, 20, 20, 20, 20, 20, 20, 20, 20, 20, 20],
   "follower_speed_mps": [14, 14, 14, 14, 14, 14, 14, 14, 14, 14, 14, 14, 14, 14, 14, 14],
   "leader_speed_mps": [14, 14, 14, 14, 14, 14, 14, 14, 14, 14, 14, 14, 14, 14, 14, 14]},
  {"event_id": "bad", "dt_s": 0.1, "spacing_m": [20, 20, 20, 20, 20, 20, 20, 20, 20, 20, 20, 20, 20, 20, 20, 20],
   "follower_speed_mps": [14, 14, 14, 14, 44, 14, 14, 14, 14, 14, 14, 14, 14, 14, 14, 14],
   "leader_speed_mps": [14, 14, 14, 14, 14, 14, 14, 14, 14, 14, 14, 14, 14, 14, 14, 14]}]}'

curl -sS --fail-with-body "$url/v1/models/quick/batches?page_size=10"
curl -sS --fail-with-body "$url/v1/models/quick/batches/b3"
curl -sS --fail-with-body "$url/v1/models/quick/batches/b3/rejections"

# What a batch holds, as an upload takes it: lines of JSON, CSV or Parquet.
curl -sS --fail-with-body "$url/v1/models/quick/batches/b3/events?format=csv"

# Where events come from. A source whose events keep failing is held until it is released; this one is not held.
curl -sS --fail-with-body "$url/v1/models/quick/sources"
curl -sS --fail-with-body -X POST "$url/v1/models/quick/sources/site-12/release"
