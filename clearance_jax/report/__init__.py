"""What a person looks at: figures and the HTML report. It is handed findings and computes none."""
