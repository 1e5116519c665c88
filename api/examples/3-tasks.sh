# Tasks: what is pending is learned, regime by regime.

url=${HEADWAY_URL:-http://127.0.0.1:8080}

# Learns what was uploaded as fast, and waits for it.
curl -sS --fail-with-body -X POST "$url/v1/models/quick/tasks" \
  -H 'Content-Type: application/json' -d '{"batches": "pending", "regime": "fast"}'
curl -sS --fail-with-body "$url/v1/models/quick/tasks/t1?wait_s=60"

# How far it is, as a stream of server-sent events that ends with the task.
curl -sS --fail-with-body -N "$url/v1/models/quick/tasks/t1/progress"

# What waits can be cancelled; its batches train again only when they are named.
curl -sS --fail-with-body -X POST "$url/v1/models/quick/pause"
curl -sS --fail-with-body -X POST "$url/v1/models/quick/tasks" \
  -H 'Content-Type: application/json' -d '{"batches": "pending", "regime": "slow"}'
curl -sS --fail-with-body -X POST "$url/v1/models/quick/tasks/t2/cancel"
curl -sS --fail-with-body -X POST "$url/v1/models/quick/resume"
curl -sS --fail-with-body -X POST "$url/v1/models/quick/tasks" \
  -H 'Content-Type: application/json' -d '{"batches": ["b2"], "regime": "slow"}'
curl -sS --fail-with-body "$url/v1/models/quick/tasks/t3?wait_s=60"

curl -sS --fail-with-body "$url/v1/models/quick/tasks"
