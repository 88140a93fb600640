"""Rule files as IEC 61131-7 Fuzzy Control Language."""
