#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Fails on a private word where the field has one of its own (docs/reference/glossary.md), so that a search for the standard term finds the code.
# Each row: a Perl regular expression and the term to use.  Legs of furniture and share_memory_() of PyTorch are exempt.  Words with a second, ordinary meaning are given by the
# phrases and identifiers in which they have the private one.
set -euo pipefail
cd "$(dirname "$0")/.."

rows=(
  '[Ss]tranger|honest worker'                               'unknown peer, peer of another build'
  '[Ff]arewell|last words'                                  'goodbye message, shutdown grace period'
  '[Vv]erdict|[Cc]ulprit|[Gg]uilty'                         'step status, faulty rank'
  '\bwishes\b|stop_wish|StopWish'                           'stop votes'
  '\b[Bb]arren|\b[Tt]roubles?\b'                            'update without an optimizer step; fault summary'
  'StageTap|set_tap|\btap\('                                'hook, observer'
  '[Mm]ended|[Mm]end_|\b[Mm]end(s|ing)?\b'                  'sanitized'
  '[Kk]ept[_ ]responses?'                                   'cached response'
  '[Rr]ay[_ ]balance|choose_copies|effective_count'         'population control, systematic_resample, effective_sample_size'
  '(^|[^a-z])([Ll]eg|[Ff]light)s?([^a-z]|$)|diffuse_last_leg' 'segment'
  '\bshares? of\b|[a-z]_share\b|\bshare_(?!memory_\()[a-z]|[a-z]Share\b|\bshare\b *[-*+=]|[^.]\bshare\(' 'fraction, weight'
  'ListenerTurn|listener_turn|to_own|hrtf[-_]turn'          'orientation, world_to_local'
  '[Ll]ate[_ ]?[Ee]ars?\b|[Ee]ar[_ ]?[Nn]oise'              'binaural late tail, precomputed binaural noise'
  '[Ll]ate[_ ]?[Nn]odes?\b|[Ss]tretch(es)?\b'               'envelope samples, segment'
  'ways? round (an? )?(edge|corner)|\b[Bb]ent\b|sound bends' 'diffraction paths, diffracted'
  '\b[Ss]ift(s|ed)?\b|sift_'                                'cull'
  '\bis_place\b|kFarthestM'                                 'is_valid_position, kMaxCoordinateM'
  'BoundKind::(asked|traded)|"(asked|traded)"|\btraded\b'   'user-set, approximated'
  'room in the queue|no room (for|in)'                      'queue capacity'
  '\b[Pp]atient\b'                                          'relaxed'
  '\b([Nn]obody|[Ss]omebody|[Ee]verybody)\b'                'no caller, a rank, all ranks'
  '[Pp]assed over'                                          'skipped'
)
exempt=':(exclude)scripts/check_words.sh :(exclude)docs/figures :(exclude)fuzz/corpus :(exclude)fuzz/dictionaries :(exclude)LICENSE'

git rev-parse --is-inside-work-tree >/dev/null
failed=0
for ((i = 0; i < ${#rows[@]}; i += 2)); do
  # shellcheck disable=SC2086
  hits=$(git grep -nIP "${rows[i]}" -- . $exempt) || { [ $? -eq 1 ] || { echo "words: git grep failed on ${rows[i]}"; exit 1; }; }
  hits=$(grep -vE 'sim/scene/generators/house_furniture\.cpp:[0-9]+:.*\bleg' <<<"$hits" || true)
  if [ -n "$hits" ]; then
    failed=1
    echo "words: use '${rows[i + 1]}' for:"
    sed 's/^/  /' <<<"$hits"
  fi
done
[ "$failed" = 0 ] && echo "words: the field's terms throughout"
exit "$failed"
