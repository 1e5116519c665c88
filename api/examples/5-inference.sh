# The Open Inference Protocol: what any client of it asks, such as Triton's.

url=${HEADWAY_URL:-http://127.0.0.1:8080}

# The server, and whether it and a model are ready.
curl -sS --fail-with-body "$url/v2"
curl -sS --fail-with-body "$url/v2/health/live"
curl -sS --fail-with-body "$url/v2/health/ready"
curl -sS --fail-with-body "$url/v2/models/quick/ready"
curl -sS --fail-with-body "$url/v2/models/quick/versions/1/ready"

# What a model takes and gives.
curl -sS --fail-with-body "$url/v2/models/quick"
curl -sS --fail-with-body "$url/v2/models/quick/versions/1"
curl -sS --fail-with-body "$url/v2/models/quick/config"
curl -sS --fail-with-body "$url/v2/models/quick/versions/1/config"

# One window: ten steps of follower speed, leader speed, relative speed and spacing.
window='[[18, 16, -2, 25.0], [18, 16, -2, 24.8], [18, 16, -2, 24.6], [18, 16, -2, 24.4], [18, 16, -2, 24.2],
         [18, 16, -2, 24.0], [18, 16, -2, 23.8], [18, 16, -2, 23.6], [18, 16, -2, 23.4], [18, 16, -2, 23.2]]'
curl -sS --fail-with-body -X POST "$url/v2/models/quick/infer" -H 'Content-Type: application/json' \
  -d "{\"inputs\": [{\"name\": \"window\", \"datatype\": \"FP32\", \"shape\": [1, 10, 4], \"data\": [$window]}]}"
curl -sS --fail-with-body -X POST "$url/v2/models/quick/versions/1/infer" -H 'Content-Type: application/json' \
  -d "{\"inputs\": [{\"name\": \"window\", \"datatype\": \"FP32\", \"shape\": [1, 10, 4], \"data\": [$window]}]}"

# A vehicle that sends its newest step alone. It stays with the version that it began with.
for parameters in '"sequence_start": true' '"sequence_end": false' '"sequence_end": true'; do
  curl -sS --fail-with-body -X POST "$url/v2/models/quick/infer" -H 'Content-Type: application/json' \
    -d "{\"parameters\": {\"sequence_id\": \"bus-12\", $parameters},
         \"inputs\": [{\"name\": \"step\", \"datatype\": \"FP32\", \"shape\": [1, 4], \"data\": [18, 16, -2, 25.0]}]}"
done

# How often, and how long it took.
curl -sS --fail-with-body "$url/v2/models/stats"
curl -sS --fail-with-body "$url/v2/models/quick/stats"
curl -sS --fail-with-body "$url/v2/models/quick/versions/1/stats"

# Which models there are; one that is unloaded is not answered for here until it is loaded again.
curl -sS --fail-with-body -X POST "$url/v2/repository/index"
curl -sS --fail-with-body -X POST "$url/v2/repository/models/quick/unload"
curl -sS --fail-with-body -X POST "$url/v2/repository/models/quick/load"
