"""The page as text; what it does is tested in a browser."""

import json
import re

from graph.drawing import draw, page
from tests.graph.drawing.diagrams import leg


def test_html_page_is_one_file_without_network_access():
    text = page(draw(leg()))
    assert not re.search(r"""(src|href)\s*=\s*["'](?!#)""", text) and "@import" not in text and "fetch(" not in text
    assert set(re.findall(r"https?://[^\s\"')<]+", text)) == {"http://www.w3.org/2000/svg"}


def test_embedded_data_is_json_with_every_block():
    drawing = draw(leg("a <script> in a name"))
    text = page(drawing)
    [data] = re.findall(r'<script type="application/json" id="data">(.*?)</script>', text, re.S)
    found = json.loads(data)
    boxes = {box.path for box in drawing.boxes}
    assert {box["path"] for box in found["drawing"]["boxes"]} == boxes == {*found["cards"], "left/knee=command"}
    assert text.count("</script>") == 2 and text.count("<script") == 2 and "a &lt;script&gt; in a name" in text
