"""A campaign's scores: what its rows say of every detector, with what each figure is uncertain by."""
