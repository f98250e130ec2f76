"""Write formulas and names in ASCII, for any compiler and editor."""

from __future__ import annotations

import itertools
import re
import unicodedata

ACCENTS = {"DOT ABOVE": "d", "DIAERESIS": "dd", "MACRON": "_bar", "CIRCUMFLEX ACCENT": "_hat", "TILDE": "_tilde"}
"""Replacements of accents: dots of a derivative go before the letter, the others behind it."""

SIGNS = {
    "⁻": "-",
    "‖": "|",
    "≤": "<=",
    "≥": ">=",
    "≠": "!=",
    "≈": "~",
    "·": " ",
    "×": "x",
    "±": "+-",
    "√": "sqrt",
    "∫": "integral ",
    "∂": "d",
    "∈": "in",
    "→": "->",
    "∞": "inf",
    "′": "'",
    "°": " deg",
    "⁄": "/",
    "–": "-",
    "−": "-",
    "“": '"',
    "”": '"',
    "’": "'",
}
SHORT = {"epsilon": "eps", "lamda": "lambda"}


def plain(text: str) -> str:
    """Transliterate a text to ASCII: τ is tau, ε̇ is deps, x² is x^2, ρ∞ is rho_inf."""
    text = text.replace("⃛", "\u0308\u0307")
    text = re.sub(r"(?<=\w)∞", "_inf", text)
    text = re.sub(r"([⁻⁰¹²³⁴-⁹ˣᵃ-ᵿᵀⁿ]+)(\w?)", lambda match: f"^{match[1]} {match[2]}".rstrip(" "), text)
    parts: list[str] = []
    for letter in unicodedata.normalize("NFKD", text):
        name = unicodedata.name(letter, "")
        if unicodedata.combining(letter) and parts:
            accent = ACCENTS.get(name.removeprefix("COMBINING "), "")
            parts[-1] = parts[-1] + accent if accent.startswith("_") else accent + parts[-1]
        else:
            parts.append(_greek(name) if name.startswith("GREEK ") else SIGNS.get(letter, letter))
    spaced = parts[:1]
    for before, part in itertools.pairwise(parts):
        # A letter that became a word needs a space before its neighbour.
        runs_on = max(len(before), len(part)) > 1 and before[-1:].isalpha() and part[:1].isalpha()
        spaced.append(f" {part}" if runs_on else part)
    return re.sub(r"[^\x20-\x7e]", "?", "".join(spaced))


def _greek(name: str) -> str:
    word = name.split()[3 if "LETTER" in name else 1].lower()
    word = SHORT.get(word, word)
    return word.capitalize() if "CAPITAL" in name else word
