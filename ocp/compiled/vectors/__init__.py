"""Operations on vectors of a processor, as LLVM IR: arithmetic and functions."""
