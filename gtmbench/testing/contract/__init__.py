"""The contract that every detector has to hold: its properties, and a case to check them on."""
