"""Child processes: started, limited, talked to and ended, with whatever they have started."""
