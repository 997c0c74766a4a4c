#define ONSET $onset_of_contact
#define WINDOW_FIRST ${first}u
#define RECORDING ${cut}u
#define EVERY ${every}u
@each crop
#define $name $value
@end
