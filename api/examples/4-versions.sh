# Versions: what tasks made, and how it drives.

url=${HEADWAY_URL:-http://127.0.0.1:8080}

curl -sS --fail-with-body "$url/v1/models/quick/versions"
curl -sS --fail-with-body "$url/v1/models/quick/versions/2"
curl -sS --fail-with-body -X PATCH "$url/v1/models/quick/versions/2" \
  -H 'Content-Type: application/json' -d '{"note": "the first that knows slow traffic"}'

# On the test events of every regime that it has learned.
curl -sS --fail-with-body "$url/v1/models/quick/versions/2/evaluation"

# On events that are not kept, beside the version before it and drivers out of the literature.
curl -sS --fail-with-body -X POST "$url/v1/models/quick/evaluate?versions=1,2&references=idm,gipps&regime=fast" \
  -H 'Content-Type: text/csv' --data-binary @fast.csv

# As a file: a graph for ONNX Runtime, and everything that learning needs to go on elsewhere, for torch or another server.
curl -sS --fail-with-body -o quick-v2.onnx "$url/v1/models/quick/versions/2/artifact?format=onnx"
curl -sS --fail-with-body -o quick-v2.safetensors "$url/v1/models/quick/versions/2/artifact?format=safetensors"

# As IDM drivers for SUMO, and how far they are from it.
curl -sS --fail-with-body -o quick-v2.add.xml "$url/v1/models/quick/versions/2/artifact?format=sumo"

# Into another model, of the same method and settings, which continues it from there.
curl -sS --fail-with-body -X POST "$url/v1/models" \
  -H 'Content-Type: application/json' -d '{"model": "moved", "method": "ewc", "settings": {"hidden": 8, "epochs": 1}}'
curl -sS --fail-with-body -X POST "$url/v1/models/moved/versions" \
  -H 'Content-Type: application/octet-stream' --data-binary @quick-v2.safetensors
