"""Systems to practise on: models as a user would write them, and recordings of them with a known effect left out."""
