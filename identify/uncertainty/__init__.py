"""How far an estimate may be off."""
