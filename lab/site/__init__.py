"""The documentation site: pages that are generated from the code, and links that lead within the site."""
