"""What was looked at: fine, or a finding."""

from __future__ import annotations

from dataclasses import dataclass

from jbclog.session.discovery.found import Finding


@dataclass(frozen=True, slots=True)
class Fine:
    """Something that is as it should be, with the same `kind` and `where` as its finding would have."""

    kind: str
    where: str
    what: str


Looked = Fine | Finding
