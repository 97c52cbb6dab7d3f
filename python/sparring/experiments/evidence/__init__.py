"""The evidence runs: do curricula train better agents? `docs/reference/evidence-protocol.md` fixes what is run and measured.

python -m sparring.experiments evidence --out evidence
"""
