APART void $name($type *x, uint32_t n)
{
    for (; n > 0; n--) {
        *x++ = 0;
    }
}

