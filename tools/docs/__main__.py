"""Writes every generated file anew, and names those that changed."""

from tools.docs.generated import ROOT, generated_files

for path, text in generated_files().items():
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        print(path.relative_to(ROOT))
