# Predictions: what the live version would do.

url=${HEADWAY_URL:-http://127.0.0.1:8080}

# The last ten steps of 0.1 s, oldest first: closing in on a slower leader.
window='{"follower_speed_mps": [18, 18, 18, 18, 18, 18, 18, 18, 18, 18],
         "leader_speed_mps": [16, 16, 16, 16, 16, 16, 16, 16, 16, 16],
         "spacing_m": [25.0, 24.8, 24.6, 24.4, 24.2, 24.0, 23.8, 23.6, 23.4, 23.2]}'

curl -sS --fail-with-body -X POST "$url/v1/models/quick/predict" \
  -H 'Content-Type: application/json' -d "{\"windows\": [$window]}"

# A version by its number, live or not.
curl -sS --fail-with-body -X POST "$url/v1/models/quick/predict" \
  -H 'Content-Type: application/json' -d "{\"windows\": [$window], \"version\": 1}"

# Half a second on, behind a leader that brakes.
curl -sS --fail-with-body -X POST "$url/v1/models/quick/simulate" \
  -H 'Content-Type: application/json' -d "{\"initial\": $window, \"leader_speed_mps\": [15.7, 15.4, 15.1, 14.8, 14.5]}"
