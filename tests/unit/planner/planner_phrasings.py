"""Tables of instructions and their meanings, for the tests of phrasings and of moves."""

from __future__ import annotations

# object | start | goal
MOVES = r"""
move the mug from the table to the sofa            | mug | table | sofa
Move mug from table to sofa                        | mug | table | sofa
move the mug to the sofa                           | mug | | sofa
move the mug to the sofa from the table            | mug | table | sofa
bring the mug to the sofa                          | mug | | sofa
bring the mug from the table onto the sofa         | mug | table | sofa
Bring me the mug from the table to the sofa        | mug | table | sofa
bring us the red mug to the kitchen counter        | red mug | | kitchen counter
take the mug to the sofa                           | mug | | sofa
take the mug from the table to the sofa            | mug | table | sofa
take the mug on the table to the sofa              | mug | table | sofa
take the mug off the table and put it on the sofa  | mug | table | sofa
take the mug out of the cabinet, put it on the desk | mug | cabinet | desk
take the mug, then place it on the sofa            | mug | | sofa
put the mug on the sofa                            | mug | | sofa
put the mug from the table on the sofa             | mug | table | sofa
put the mug that is on the table on the sofa       | mug | table | sofa
put the mug which is currently standing on the table onto the sofa | mug | table | sofa
put the mug lying on the table into the sink       | mug | table | sink
put down the mug on the desk                       | mug | | desk
put the mug down on the desk                       | mug | | desk
put the mug back on the shelf                      | mug | | shelf
put the mug in the sink                            | mug | | sink
put the mug inside the cabinet                     | mug | | cabinet
put the mug on top of the fridge                   | mug | | fridge
place the mug onto the tv stand                    | mug | | tv stand
place a mug upon the bench                         | mug | | bench
set the mug on the nightstand                      | mug | | nightstand
set down the mug on the nightstand                 | mug | | nightstand
lay the towel over on the bed                      | towel | | bed
lay the towel over the chair                       | towel | | chair
hang the towel from the bed over the chair         | towel | bed | chair
drape the blanket over a sofa                      | blanket | | sofa
take the mug over the sink and put it on the desk  | mug | sink | desk
bring over the mug to the sofa                     | mug | | sofa
carry the teddy bear to the bed                    | teddy bear | | bed
transport the box from the desk to the bench       | box | desk | bench
transfer the bowl from the counter to the dining table | bowl | counter | dining table
deliver the book to the desk                       | book | | desk
drop the can into the trash can                    | can | | trash can
drop off the book at the desk                      | book | | desk
return the book to the bookcase                    | book | | bookcase
leave the keys on the side table                   | keys | | side table
store the towel in the wardrobe                    | towel | | wardrobe
hand the book over to the desk                     | book | | desk
fetch the cup from the desk and bring it to the sofa | cup | desk | sofa
fetch the cup and put it on the sofa               | cup | | sofa
grab the cup on the desk and put it on the sofa    | cup | desk | sofa
grab the cup from the desk & place it on the sofa  | cup | desk | sofa
get the cup off of the desk and move it to the sofa | cup | desk | sofa
go get the cup and put it on the sofa              | cup | | sofa
go and fetch the cup from the desk and bring it back to the sofa | cup | desk | sofa
go to the desk, grab the cup and bring it to the sofa | cup | desk | sofa
pick up the cup from the desk and place it on the sofa | cup | desk | sofa
pick the cup up from the desk and put it down on the sofa | cup | desk | sofa
collect the cup from the desk then deliver it to the sink | cup | desk | sink
retrieve the cup from inside the cabinet and put it on the desk | cup | cabinet | desk
remove the cup from the desk and put it in the sink | cup | desk | sink
lift the cup from the desk onto the shelf          | cup | desk | shelf
find the cup and bring it to the sofa              | cup | | sofa
find the cup on the desk and then put it on the sofa | cup | desk | sofa
look for the cup, pick it up and put it on the sofa | cup | | sofa
find a cup, grab it, and put it on the sofa        | cup | | sofa
find the cup and take it to the sofa               | cup | | sofa
from the table, bring the mug to the sofa          | mug | table | sofa
From the table to the sofa, move the mug           | mug | table | sofa
the mug on the table: bring it to the sofa         | mug | table | sofa
the mug should be moved from the table to the sofa | mug | table | sofa
The mug needs to be brought to the sofa            | mug | | sofa
the mug on the table has to be put on the sofa     | mug | table | sofa
the mug belongs on the shelf                       | mug | | shelf
bring the red coffee mug to the kitchen counter    | red coffee mug | | kitchen counter
bring the big, red mug to the sofa                 | big red mug | | sofa
bring the small blue-green vase to the tv stand    | small blue-green vase | | tv stand
bring the glass of water to the bedside table      | glass of water | | bedside table
move the roll of tape to the chest of drawers      | roll of tape | | chest of drawers
move the remote control from the filing cabinet to the bed | remote control | filing cabinet | bed
move the rubik's cube to the shoe rack             | rubik's cube | | shoe rack
move one of the mugs to the sofa                   | mugs | | sofa
move another mug to the sofa                       | mug | | sofa
move that can to my desk                           | can | | desk
move some bread from this plate to that table      | bread | plate | table
move the coffee_mug from the coffee_table to the TV_stand | coffee mug | coffee table | tv stand
move the mug from the table in the kitchen to the sofa in the living room | mug | table | sofa
bring the mug from the kitchen to the sofa         | mug | | sofa
bring the mug with the blue handle to the sofa     | mug | | sofa
bring the mug that I like to the sofa              | mug | | sofa
move the mug, which is red, from the table to the sofa | mug | table | sofa
move the mug very carefully to the sofa            | mug | | sofa
if you can, move the mug to the sofa               | mug | | sofa
bring the mug to the sofa for grandma              | mug | | sofa
bring the mug to the sofa because I am thirsty     | mug | | sofa
bring the mug to the sofa, please                  | mug | | sofa
Please bring the mug to the sofa now.              | mug | | sofa
Hey robot, could you please bring the mug to the sofa?! | mug | | sofa
ok helios: i would like you to put the mug on the sofa, thank you | mug | | sofa
Would you mind, just bring the mug to the sofa quickly | mug | | sofa
let's move the mug to the sofa                     | mug | | sofa
your task is to move the mug from the table to the sofa. | mug | table | sofa
  MOVE   THE   MUG   TO   THE   SOFA  !!!          | mug | | sofa
“Move the mug to the sofa”                         | mug | | sofa
move the mug to the sofa 🙂                         | mug | | sofa
move the mug from one table to another table       | mug | table | table
Ｍｏｖｅ　ｔｈｅ　ｍｕｇ　ｔｏ　ｔｈｅ　ｓｏｆａ                | mug | | sofa
mo\u200bve the m\u00adug to the sofa               | mug | | sofa
move\u00a0the\u2003mug\tto\nthe sofa               | mug | | sofa
move the cafe\u0301 mug to the sofa                | café mug | | sofa
brign the mug to the sofa                          | mug | | sofa
mov the mug from the table to the sofa             | mug | table | sofa
movve the mug to the sofa                          | mug | | sofa
pleese take teh mug frm the table to the sofa      | mug | table | sofa
bring the mug too the sofa plz                     | mug | | sofa
mug from table to sofa                             | mug | table | sofa
grab mug -> sofa                                   | mug | | sofa
move mug from table → sofa                         | mug | table | sofa
I need the mug on the sofa                         | mug | | sofa
I'd like the mug moved from the table to the sofa  | mug | table | sofa
could the mug be brought to the sofa?              | mug | | sofa
is it possible to move the mug to the sofa?        | mug | | sofa
why don't you bring the mug to the sofa            | mug | | sofa
there is a mug on the table. bring it to the sofa  | mug | table | sofa
There's a mug on the table, please put it on the sofa | mug | table | sofa
I think the mug is on the table, bring it to the sofa | mug | table | sofa
my mug is on the desk; put it in the sink          | mug | desk | sink
put the mug I left on the table in the sink        | mug | table | sink
put the mug, which you find on the table, on the sofa | mug | table | sofa
bring the mug from the table near the window to the sofa | mug | table | sofa
bring the mug on the table next to the sofa to the bed | mug | table | bed
bring 1 mug to the sofa                            | mug | | sofa
throw the can in the trash can                     | can | | trash can
load the plate into the dishwasher                 | plate | | dishwasher
bring the 🍎 apple to the table 🙏🙏🙏                 | apple | | table
bring the mug to the sofa as soon as you can       | mug | | sofa
As soon as you can, bring the mug to the sofa      | mug | | sofa
please, as soon as possible bring the mug to the sofa | mug | | sofa
bring the mug as soon as possible to the sofa      | mug | | sofa
bring the mug to the sofa as quickly as you can, thanks | mug | | sofa
bring the mug to the sofa whenever you like        | mug | | sofa
when you can just bring the mug from the desk to the sofa | mug | desk | sofa
bring the mug right now from the desk to the sofa  | mug | desk | sofa
bring the mug at once to the sofa                  | mug | | sofa
bring the mug immediately to the sofa              | mug | | sofa
bring the mug to the sofa just in case             | mug | | sofa
take the mug if you can and put it on the sofa     | mug | | sofa
put the phone in the case on the desk              | phone | case | desk
move the case from the sofa to the desk            | case | sofa | desk
bring the mug from the sofa to the sofa            | mug | sofa | sofa
would you mind moving the lamp to the desk?        | lamp | | desk
How about putting the mug on the shelf             | mug | | shelf
running shoe from the floor to the shelf           | running shoe | floor | shelf
I left my phone on the sofa, can you bring it to the desk | phone | sofa | desk
The mug should be on the counter. Bring it to the sofa | mug | counter | sofa
theres a mug on the table, bring it to the sink    | mug | table | sink
It's cold, bring the blanket from the closet to the couch | blanket | closet | couch
I spilled coffee. Bring a towel to the table.      | towel | | table
1. move the mug to the sofa                        | mug | | sofa
could u move the mug to the sofa                   | mug | | sofa
pick-up the mug and put it on the sofa             | mug | | sofa
place mug @ table                                  | mug | | table
slide the plate onto the counter                   | plate | | counter
move the black and white ball to the sofa          | black and white ball | | sofa
put the cup back on the shelf where it belongs     | cup | | shelf
the mug needs to be on the counter                 | mug | | counter
pick up the mug from the table, go to the sofa and place it | mug | table | sofa
go to the table, pick up the mug, go to the sofa, and put it down | mug | table | sofa
find mug, pick it, go to sofa, place it            | mug | | sofa
put the mug on the chair at the desk               | mug | | chair
bring the mug without a handle to the sofa         | mug | | sofa
Can't you bring the mug to the sofa?               | mug | | sofa
bring the mug to the sofa, it is on the table      | mug | table | sofa
Bring the mug to the sofa. It's still on the table. | mug | table | sofa
Bring the mug to the sofa, I left it on the table  | mug | table | sofa
Bring the mug to the sofa. I am thirsty.           | mug | | sofa
"""

# object | start
FINDS = r"""
find the remote                        | remote |
Find my remote control!                | remote control |
find a book on the desk                | book | desk
find the book that is lying on the desk | book | desk
locate the blue vase                   | blue vase |
look for the keys                      | keys |
search for the keys in the cabinet     | keys | cabinet
search the desk for the keys           | keys | desk
look on the desk for the keys          | keys | desk
Where is the remote?                   | remote |
where's my phone                       | phone |
where are my keys                      | keys |
tell me where the phone is             | phone |
could you find out where my keys are   | keys |
search everywhere for the phone        | phone |
can you see the phone?                 | phone |
have you seen my phone                 | phone |
is there a mug on the table?           | mug | table
show me the mug                        | mug |
go find the teddy bear                 | teddy bear |
please go and look for the teddy bear  | teddy bear |
go to the counter and find the mug     | mug | counter
find the mug in the kitchen            | mug |
help me find the mug                   | mug |
have you seen the remote anywhere?     | remote |
any idea where the keys are            | keys |
I can't find my keys                   | keys |
I lost my phone                        | phone |
look around for the cup                | cup |
check if there is a mug on the table   | mug | table
serach for the mug                     | mug |
can you see if there's a banana on the counter     | banana | counter
search the house for a fire extinguisher           | fire extinguisher |
search the desk for a second mug                   | second mug | desk
Find my keys, they are on the sofa                 | keys | sofa
"""

GOES = r"""
go to the sofa                         | sofa
Go to the sofa in the living room      | sofa
drive to the kitchen counter           | kitchen counter
move to the sofa                       | sofa
please head over to the bed            | bed
navigate towards the dining table      | dining table
come to the desk                       | desk
walk up to the tv stand                | tv stand
go near the sofa                       | sofa
go next to the bed                     | bed
travel to the washing machine now      | washing machine
return to the bench                    | bench
pls drvie to the kitchen counter thx   | kitchen counter
approach the sofa                                  | sofa
get to the sofa                                    | sofa
go from the desk to the sofa                       | sofa
Go to the sofa. There is a party on the balcony.   | sofa
"""

# x | y | degrees
POINTS = r"""
go to 3.2, 4.1                                      | 3.2 | 4.1 |
go to (3.2, 4.1) facing 90 degrees                  | 3.2 | 4.1 | 90
Go to (-3.2 m, -4.1 m), facing -90°                 | -3.2 | -4.1 | -90
please go to x=3.2 y=4.1 now                        | 3.2 | 4.1 |
go 3 4                                              | 3 | 4 |
drive to the point (3,4) with yaw 1.5 rad           | 3 | 4 | 85.94
navigate to [1.5; 2]                                | 1.5 | 2 |
move to 3.2, 4.1                                    | 3.2 | 4.1 |
return to 0, 0                                      | 0 | 0 |
could you drive over to position 3.25 4.5?          | 3.25 | 4.5 |
go to \u22121.0, 2                                  | -1 | 2 |
go to 3.2 metres, 4.1 metres and then face 270      | 3.2 | 4.1 | -90
head to the location at .5, -.25 with a heading of 360 degrees | 0.5 | -0.25 | 0
go to the coordinates (2, 3), heading 45            | 2 | 3 | 45
"""

# kind | seconds
ONLY_MOVES = r"""
explore                                             | explore |
explore the home                                    | explore |
please explore the whole house                      | explore |
explore everything                                  | explore |
explore the rest of the flat                        | explore |
explore the home for two minutes                    | explore | 120
explore for 90s                                     | explore | 90
explore for at most 1.5 minutes                     | explore | 90
explore for half an hour                            | explore | 1800
go explore                                          | explore |
start exploring                                     | explore |
map the apartment                                   | explore |
scan the home                                       | explore |
come back                                           | go_home |
go home                                             | go_home |
Come home, please!                                  | go_home |
go back                                             | go_home |
return                                              | go_home |
return home                                         | go_home |
return to the start                                 | go_home |
return to your starting point                       | go_home |
go back to where you started                        | go_home |
drive straight back to the start                    | go_home |
back to the start                                   | go_home |
move to the start position                          | go_home |
hey robot, could you come back now                  | go_home |
"""

# part of the refusal
REFUSED = r"""
                                                    | empty
?!...                                               | empty
\u200b\u200b                                        | empty
move                                                | the object to move and the place
move the mug                                        | object “mug”; missing: the place to bring it
move to                                             | the object to move
move from the table to the sofa                     | from “table”, to “sofa”; missing: the object
bring it to the sofa                                | to “sofa”; missing: the object to move
bring me something                                  | the object to move
fetch me the cup from the desk                      | object “cup”, from “desk”; missing: the place
bring the mug to me                                 | “me” is no piece of furniture
put the mug there                                   | missing: the place
put the mug in the kitchen                          | “kitchen” is a room
go to the kitchen                                   | “kitchen” is none
go                                                  | a piece of furniture
go to the sofa and the bed                          | several things
go to the sofa and go to the bed                    | more than one place
find                                                | the object to find
find it                                             | the object to find
find the mug and the bowl                           | several things
Move the mug from the mug to the mug                | other than the mug itself
put the mug on the mug                              | other than the mug itself
move the mug to the sofa and to the bed             | 2 goals (sofa, bed)
move the mug to the sofa or the bed                 | several things
move the mug from the desk and from the table to the bed | 2 places
move the mug and the bowl to the bed                | several things at once (mug, bowl)
move the mug, the bowl and the can to the bed       | several things
take the mug to the sofa and the bowl to the bed    | several things
bring the mug to the sofa and put the bowl on the bed | 2 objects (mug, bowl)
take the mug and go to the bed                      | several things
move two mugs to the sofa                           | several things
move 3 mugs to the sofa                             | several things
move all the mugs to the sofa                       | several things
don't move the mug to the sofa                      | not to be done (“don't”)
never put the mug on the sofa                       | not to be done
put the mug not on the sofa but on the bed          | not to be done
put the mug next to the plate                       | “next to the plate” cannot be done
move the chair closer to the table                  | “closer to the table” cannot be done
move the mug under the table to the sofa            | “under the table” cannot be done
if the mug is dirty, put it in the sink             | a condition (“if”)
if it rains bring the mug to the sofa               | a condition (“if”)
bring the mug to the sofa if it is dirty            | a condition (“if”)
bring the mug to the sofa in case it is dirty       | a condition (“in case”)
in case the mug is dirty, put it in the sink        | a condition (“in case”)
bring the mug to the sofa just in case it rains     | a condition (“in case”)
bring the mug to the sofa as soon as it is clean    | a condition (“as soon as”)
as soon as the mug is clean, put it on the sofa     | a condition (“as soon as”)
bring the mug to the sofa as soon as you can see it | a condition (“as soon as”)
bring the mug to the sofa as long as it is clean    | a condition (“as long as”)
bring the mug to the sofa so long as it is clean    | a condition (“so long as”)
bring the mug to the sofa provided that it is clean | a condition (“provided that”)
bring the mug to the sofa given that it is clean    | a condition (“given that”)
bring the mug to the sofa assuming it is clean      | a condition (“assuming”)
bring the mug to the sofa only if it is dirty       | a condition (“only if”)
bring the mug to the sofa even if it is dirty       | a condition (“even if”)
bring the mug to the sofa once you see it           | a condition (“once”)
bring the mug to the sofa if you can reach it       | a condition (“if”)
bring the mug to the sofa the next time you pass it | a condition (“the next time”)
go to the sofa in case I am there                   | a condition (“in case”)
find the mug as soon as I leave                     | a condition (“as soon as”)
make me happy                                       | no verb
the quick brown fox                                 | no verb
clean the table                                     | no verb
what is on the table                                | no verb
mug sofa                                            | no verb
hello                                               | no verb
bewege die Tasse vom Tisch zum Sofa                 | looks like German
déplace la tasse de la table au canapé              | looks like French
mueve la taza de la mesa al sofá                    | looks like Spanish
sposta la tazza dal tavolo al divano                | looks like Italian
przenieś kubek ze stołu na sofę                     | looks like Polish
переместите кружку со стола на диван                | Cyrillic
把杯子从桌子移到沙发上                                        | Chinese
カップをソファに動かして                                       | Katakana
انقل الكوب إلى الأريكة                              | Arabic
mоve the mug to the sofa                            | “о” is a letter of another script (Cyrillic)
DROP TABLE tasks; --                                | missing: the place
bring die Tasse vom Tisch zum Sofa                  | looks like German
kannst du die Tasse auf das Sofa stellen            | looks like German
où est la tasse                                     | looks like French
¿Dónde está la taza?                                | looks like Spanish
onde está a caneca?                                 | looks like Portuguese
पकड़ो                                                | Devanagari
🤖 ☕ 🛋️                                              | empty
🤖 bring ☕ to the 🛋️                                 | only the verb
stop                                                | `helios stop`
cancel!                                             | `helios cancel`
the mug is on the table                             | no verb
mug to sofa                                         | no verb
bring the mug to the sofa and come back             | several things
put the mug away                                    | object “mug”; missing: the place
put the toy in the box under the bed                | “under the bed” cannot be done
bake the bread on the table to the sofa             | no verb
move it to the table                                | to “table”; missing: the object to move
put my keys where I can find them                   | object “keys”; missing: the place
take the red and the blue mug to the sofa           | several things at once (red, blue mug)
move a couple of mugs to the table                  | several things
the red mug, move to the sofa                       | no verb
if I am thirsty, bring the cup to the desk          | a condition (“if”)
Bring the mug to the sofa instead of the bed        | not to be done (“instead of”)
Find anything but the mug                           | not to be done (“but”)
bring no can to the sofa                            | not to be done (“no”)
bring neither the mug nor the can to the sofa       | not to be done (“neither”)
bring anything other than the mug to the sofa       | not to be done (“other than”)
go anywhere except the sofa                         | not to be done (“except”)
go to the bed via the sofa                          | more than one place
go away from the bed                                | a piece of furniture to go to
bring the mug to the sofa and back                  | several things at once (“and back”)
bring a dozen cans to the sofa                      | several things
bring each can to the sofa                          | several things
PLEASE STOP!!!                                      | `helios stop`
Hey robot, could you stop now                       | `helios stop`
Refuse to bring the mug to the sofa                 | to the sofa”; start with move
go to 3.2, 4.1, 90                                  | gives three numbers; write two
go to (1.20, 3.40, 0.78) m                          | gives three numbers; write two
go to 3.2                                           | no point; write “go to 3.2, 4.1”
go to 320 cm, 400 cm                                | no point; write “go to 3.2, 4.1”
go 2 metres forward                                 | no point; write “go to 3.2, 4.1”
go to 3.2, 4.1 facing north                         | but not “(3.20, 4.10) m facing north”
go to 3.2, 4.1 and find the cup                     | only the robot itself can be sent
bring the mug to 3.2, 4.1                           | only the robot itself can be sent
go to 99999, 1                                      | beyond 10000 m
go from 1, 2 to 3, 4                                | understood the point (1.00, 2.00) m
go to the sofa at 3.2, 4.1                          | but not “sofa”
go to 3, 4 if it is free                            | a condition (“if”)
don't go to 3, 4                                    | not to be done
explore the kitchen                                 | rooms are not told apart
explore and come back                               | submit a task for anything else
explore the table                                   | “table” is not what can be explored
explore for 0 seconds                               | wanted more than 0 s
explore for 100 hours                               | at most 86400 s
Find the mug within 5 minutes                       | time limit “within 5 minutes”
look for a second mug for at most 90 s              | set time_limit_s of the task
go to the sofa for 30 hours                         | time limit “for 30 hours”
bring the mug to the sofa for a minute, please      | time limit “for a minute”
go to 3.2, 4.1 within two minutes                   | time limit “within two minutes”
come back within 10 min                             | helios task --time-limit-s SECONDS
map                                                 | no verb
turn left                                           | no task for “turn”
turn around                                         | “explore the home”, “come back”
rotate 90 degrees                                   | no task for “rotate”
dock                                                | no task for “dock”
come here                                           | no task for “come here”
come to me                                          | no task for “come to me”
follow me                                           | no task for “follow”
drive forward                                       | no task for “drive forward”
move back                                           | no task for “move back”
"""


def rows(table: str) -> list[tuple[str, ...]]:
    """Split a table into cells; its escapes are those of Python."""
    out = []
    for line in table.splitlines()[1:]:
        for escape, letter in (
            ("\\u200b", "\u200b"),
            ("\\u00ad", "\u00ad"),
            ("\\n", "\n"),
            ("\\u2212", "\u2212"),
            ("\\u00a0", "\u00a0"),
            ("\\u2003", "\u2003"),
            ("\\t", "\t"),
            ("\\u0301", "\u0301"),
        ):
            line = line.replace(escape, letter)
        text, *cells = line.split("|")
        out.append((text.rstrip(" "), *(cell.strip() for cell in cells)))
    return out
