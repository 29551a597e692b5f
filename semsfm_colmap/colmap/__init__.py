"""The only home of pycolmap: database, sparse model, telecentric pinhole, reading back."""
