# What serves, and going back.

url=${HEADWAY_URL:-http://127.0.0.1:8080}

# Serving goes back to version 1; learning goes on from version 2.
curl -sS --fail-with-body -X POST "$url/v1/models/quick/promote" \
  -H 'Content-Type: application/json' -d '{"version": 1, "reason": "look at it again"}'
curl -sS --fail-with-body -X POST "$url/v1/models/quick/promote" \
  -H 'Content-Type: application/json' -d '{"version": 2, "reason": "it was all right"}'

# Serving and learning go back to version 1, as if version 2 had never been.
curl -sS --fail-with-body -X POST "$url/v1/models/quick/rollback" \
  -H 'Content-Type: application/json' -d '{"reason": "worse on the motorway"}'

curl -sS --fail-with-body "$url/v1/models/quick/history"
