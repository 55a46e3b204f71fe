"""A PDF read without what made it: its texts by pypdfium2, its structure by pikepdf (ISO 19005-2,
the rules that matter here).
"""

from __future__ import annotations

import io
from collections.abc import Iterator

import pikepdf
import pypdfium2

PDF_A = "http://www.aiim.org/pdfa/ns/id/"
ACTING = (
    "/JavaScript",
    "/JS",
    "/Launch",
    "/SubmitForm",
    "/ImportData",
    "/GoToR",
    "/URI",
    "/EmbeddedFiles",
    "/OpenAction",
    "/AA",
)


def page_texts(data: bytes) -> list[str]:
    """What each page says, in reading order."""
    document = pypdfium2.PdfDocument(data)
    try:
        return [page.get_textpage().get_text_range().replace("\r\n", "\n") for page in document]
    finally:
        document.close()


def faults(data: bytes) -> list[str]:
    """What keeps it from PDF/A-2a, or from being only paper."""
    with pikepdf.open(io.BytesIO(data)) as pdf:
        return [*_identified(pdf), *_tagged(pdf), *_coloured(pdf), *_fonts(pdf), *_acting(pdf)]


def _identified(pdf: pikepdf.Pdf) -> Iterator[str]:
    with pdf.open_metadata() as meta:
        said = (meta.get(f"{{{PDF_A}}}part"), meta.get(f"{{{PDF_A}}}conformance"))
    if said != ("2", "A"):
        yield f"its metadata claim part and conformance {said}"
    if pdf.is_encrypted or "/ID" not in pdf.trailer:
        yield "encrypted, or without an identifier"


def _tagged(pdf: pikepdf.Pdf) -> Iterator[str]:
    if not pdf.Root.get("/MarkInfo", {}).get("/Marked"):
        yield "not marked as tagged"
    if not str(pdf.Root.get("/Lang", "")).startswith("en"):
        yield "no language"
    kinds = list(_elements(pdf.Root.get("/StructTreeRoot", {}).get("/K")))
    lacking = {"/H1", "/Table", "/TH", "/P"} - {str(one.S) for one in kinds}
    if lacking:
        yield f"its structure has no {lacking}"
    if any(str(one.S) == "/Figure" and not str(one.get("/Alt", "")) for one in kinds):
        yield "a figure without an alternative text"


def _elements(kids: object) -> Iterator[pikepdf.Object]:
    for kid in kids if isinstance(kids, pikepdf.Array) else [kids]:
        if isinstance(kid, pikepdf.Dictionary) and "/S" in kid:
            yield kid
            yield from _elements(kid.get("/K"))


def _coloured(pdf: pikepdf.Pdf) -> Iterator[str]:
    intents = list(pdf.Root.get("/OutputIntents", []))
    if not any(
        str(one.S) == "/GTS_PDFA1" and len(one.DestOutputProfile.read_bytes()) > 128
        for one in intents
    ):
        yield "no output intent with a colour profile"


def _fonts(pdf: pikepdf.Pdf) -> Iterator[str]:
    fonts = [
        one
        for one in pdf.objects
        if isinstance(one, pikepdf.Dictionary) and one.get("/Type") == "/Font"
    ]
    if not fonts:
        yield "no fonts"
    for font in fonts:
        if "/DescendantFonts" in font:
            if "/ToUnicode" not in font:
                yield f"{font.BaseFont}: its letters cannot be told as text"
        elif not {"/FontFile", "/FontFile2", "/FontFile3"} & set(
            font.get("/FontDescriptor", {}).keys()
        ):
            yield f"{font.BaseFont}: not in the file"


def _acting(pdf: pikepdf.Pdf) -> Iterator[str]:
    for one in pdf.objects:
        if isinstance(one, pikepdf.Dictionary | pikepdf.Stream):
            yield from (f"it has {key}" for key in ACTING if key in one or one.get("/S") == key)
